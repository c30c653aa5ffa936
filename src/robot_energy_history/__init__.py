"""Energy over years: what each robot used, by minute, quarter hour and day, in whole microjoules.

`store` writes, `differences` holds the rules, `spans` reads; `api.history` is what users call.
"""
