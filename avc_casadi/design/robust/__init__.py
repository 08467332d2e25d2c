"""The wall behind an observer with state feedback, for every hand and a device not quite as declared."""
