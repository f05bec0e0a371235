"""Settings of what is measured beside recognition: config/survey.yaml."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta

from ascrcp.core.config import Struct, load
from ascrcp.core.paths import CONFIG

Length = Annotated[float, Meta(gt=0.0, le=100.0)]
Short = Annotated[float, Meta(gt=0.0, le=1.0)]
Share = Annotated[float, Meta(gt=0.0, le=1.0)]


class AlignmentParameters(Struct):
    """Where the lance is looked for [m], and what is believed of it (thesis 3.2)."""

    reach: Length
    aside: Length
    height: Length
    max_zero_deg: Annotated[float, Meta(gt=0.0, le=15.0)]
    min_length: Length
    max_residual: Short


class RegistrationParameters(Struct):
    """Cubes and first pairing distance [m], size of the problem, and what is the same wall."""

    voxel: Annotated[float, Meta(ge=0.01, le=0.5)]
    reach: Annotated[float, Meta(ge=0.02, le=3.0)]
    points: Annotated[int, Meta(ge=1000, le=2_000_000)]
    iterations: Annotated[int, Meta(ge=5, le=500)]
    min_share: Share
    max_residual: Short


class ThicknessParameters(Struct):
    """Cells [m], points needed in each, the band that may be wall [m], and what is scatter [m]."""

    cell: Annotated[float, Meta(ge=0.02, le=0.5)]
    min_points: Annotated[int, Meta(ge=1, le=100)]
    inside: Length
    outside: Length
    scatter: Short


class UnderbreakParameters(Struct):
    """How far rock may reach inside the design line [m], smallest region named [m2]."""

    tolerance: Annotated[float, Meta(ge=0.0, le=1.0)]
    min_area: Annotated[float, Meta(ge=0.0, le=10.0)]


class SurveyParameters(Struct):
    """All of them."""

    alignment: AlignmentParameters
    registration: RegistrationParameters
    thickness: ThicknessParameters
    underbreak: UnderbreakParameters


def load_survey(path: Path | None = None) -> SurveyParameters:
    """Read the settings, config/survey.yaml by default.

    Raises:
        ConfigError: With the key and the rule it breaks.
    """
    return load(path or CONFIG / "survey.yaml", SurveyParameters)
