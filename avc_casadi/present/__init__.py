"""Results for people: figures, reports, the local page."""
