"""An end of an interval that does not belong to it."""


class AboveZero(float):
    """The lower end of an interval of every value above 0 but not 0: the least value that was judged."""
