"""What all nodes share: parameters, subscriptions, publishers, life cycle."""
