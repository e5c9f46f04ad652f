"""What will be modelled and what it costs, before anything runs."""
