"""The link to a device: bytes, frames, messages, session, and what a host does over them."""
