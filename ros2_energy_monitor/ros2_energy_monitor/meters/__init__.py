"""Power meters on the network: profiles, links, and the poller that reads them."""
