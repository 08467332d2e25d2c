"""Serial link to the device: bytes, frames, messages, session; firmware in C beside it."""
