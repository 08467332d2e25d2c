"""Presentation of results: figures, reports, the local page."""
