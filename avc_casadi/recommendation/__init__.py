"""Which coupling to deploy, how stiff it renders, what limits it."""
