"""How sure a predicted watt or joule is."""
