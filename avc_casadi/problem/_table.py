"""What all tables of a problem file have in common."""

from pydantic import BaseModel, ConfigDict


class Table(BaseModel):
    """A frozen table: unknown keys, wrong types and numbers that are not finite are refused."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid", allow_inf_nan=False)
