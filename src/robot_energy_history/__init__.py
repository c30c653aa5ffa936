"""Energy over years: what each robot used, by minute, quarter hour, day and job.

All in whole microjoules. `store` writes, `differences` holds the rules, `spans` reads; `api` is
what users call.
"""
