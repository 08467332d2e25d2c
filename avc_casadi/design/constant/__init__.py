"""Methods that find gains which do not vary with frequency."""
