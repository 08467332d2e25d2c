"""Trade-off study: what each guarantee costs in realism, and what adaptation wins over constant gains."""
