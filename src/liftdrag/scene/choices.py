"""The numerics that a user sets by hand instead of having them derived."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from liftdrag.scene.model import Part
from liftdrag.scene.quantities import Length, Time


class Choices(Part):
    """The table `[numerics]` of a case; what is absent is derived."""

    time_step: Time | None = None
    skin: Length | None = None
    sample_every: Annotated[int, Field(ge=1, le=1000)] | None = None
    restart_every: Annotated[int, Field(ge=1, le=2_000_000_000)] | None = None
    settle_time: Time | None = None
    pair_law: Literal["granular", "hertz/history"] = "granular"
