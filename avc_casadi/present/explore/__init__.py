"""The local page with sliders."""
