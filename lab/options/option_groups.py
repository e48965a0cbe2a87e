"""Define options that campaigns share: of the fit, and of a virtual arm's effects."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

import tyro

from lab.core.errors import LabError
from lab.core.limits import positive
from lab.core.units import MM, MRAD
from lab.extension_points import named_parts
from lab.kinematics.effects.effect import VirtualEffect
from lab.kinematics.effects.effect_registry import GROUPS, EffectOptions, fitted_groups, own_effect_options
from lab.options.option_types import PRIOR_MODES, Flag, Names, Numbers, PriorMode

if TYPE_CHECKING:
    from lab.calibration.fit_options import FitOptions

__all__ = ["Effects", "Fitting"]

_Options = TypeVar("_Options", bound=EffectOptions)


_GROUPS = [f"{each.name} ({each.meaning})" if each.meaning else each.name for each in fitted_groups()]
_MODEL_HELP = "geometric; auto, which adds the groups that the data support; or groups joined by +.\n\nGroups: "
_MODEL_HELP += ", ".join(  # below the empty line: for --help-all
    [
        *_GROUPS,
        "residual (what no group explains, as offsets of the joints; also auto+residual)",
        "those that packages add, which auto tries only where named: auto+NAME.",
    ]
)


@dataclass(frozen=True)
class Fitting:
    """Options of the fit."""

    model: Annotated[str, tyro.conf.arg(help=_MODEL_HELP)] = "geometric"
    robust: Flag = False
    """Exclude outliers, found by a test with a false alarm in 1 % of clean campaigns."""
    fix: Names = ()
    """Fix these parameters at nominal: names or patterns, e.g. link4.d,tool.*."""
    free: Names = ()
    """Identify these parameters, which are usually fixed, in the place of fixed ones."""
    prior: PriorMode = "auto"
    """Manufacturing tolerances as a prior (MAP): auto, only in weakly observable directions, at an estimated scale;
    on (also the bare flag), in all directions, as given; off, not at all."""
    tolerance_mm: float = 0.5
    """Manufacturing tolerance of lengths (1σ): of the prior, and by which aliased errors are shared in exports."""
    tolerance_mrad: float = 1.5
    """Manufacturing tolerance of angles (1σ); 7/3 of it of twists between nominally parallel axes."""
    estimator: str = "least-squares"
    """Estimator of the parameters: least-squares. Packages may add others."""
    error_terms: Names = ()
    """Also search these error terms among the noise: names that packages add."""
    accept: Names = ()
    """Undo these mistakes of reading, which the diagnosis found: their names, e.g. joint_sign or joint_sign:q3."""
    load: Path | None = None
    """The folder of a run of lab payload: it places all payloads; rows without payload_kg have its mass."""
    accept_edited: Flag = False
    """Accept a --load run whose files were changed since it was written."""

    def __post_init__(self) -> None:
        """Take the truth values of older runs and calls for on and off."""
        if isinstance(self.prior, bool):
            object.__setattr__(self, "prior", "on" if self.prior else "off")

    def check(self) -> None:
        """Refuse numbers that make no sense, with a LabError that names the option."""
        if self.prior not in PRIOR_MODES:
            raise LabError(f"--prior {self.prior}: give {', '.join(PRIOR_MODES)}")
        positive("--tolerance-mm", self.tolerance_mm)
        positive("--tolerance-mrad", self.tolerance_mrad)
        named = self.model.split("+")
        if not all(named) or len(set(named)) < len(named):
            raise LabError(f"--model {self.model}: give geometric, auto, or different groups joined by +")
        if self.searched and (usual := [name for name in self.groups if name in (*GROUPS, "geometric")]):
            raise LabError(
                f"--model {self.model}: {usual[0]} is no such group as goes with auto, which chooses among the lab's "
                "by itself; add groups of packages alone"
            )
        if self.residual and self.prior == "on":
            raise LabError(
                "--prior on: the group residual takes no prior of all parameters; give --prior auto, or no residual"
            )

    @property
    def searched(self) -> bool:
        """True if the data choose the groups."""
        return "auto" in self.parametric.split("+")

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups requested by name, which a search only tries; none for geometric and auto alone."""
        if self.searched:
            return tuple(name for name in self.parametric.split("+") if name != "auto")
        named = self.parametric
        return () if named == "geometric" else tuple(named.removeprefix("geometric+").split("+"))

    @property
    def residual(self) -> bool:
        """True if the residual that no group explains is predicted, as joint offsets."""
        return "residual" in self.model.split("+")

    @property
    def parametric(self) -> str:
        """The model without the residual."""
        return "+".join(name for name in self.model.split("+") if name != "residual") or "geometric"

    def to_si(self) -> "FitOptions":
        """Return the options of the fit in SI units.

        Raises:
            LabError: there is no such estimator or error term.
        """
        from lab.calibration.estimator import estimator_named
        from lab.calibration.fit_options import FitOptions
        from lab.calibration.prior import Tolerance
        from lab.noise.error_term import own_term

        for name in self.error_terms:
            own_term(name)
        return FitOptions(
            groups=() if self.searched else self.groups,
            search=self.searched,
            residual=self.residual,
            robust=self.robust,
            fix=self.fix,
            free=self.free,
            prior=self.prior,
            tolerance=Tolerance(MM.to_si(self.tolerance_mm), MRAD.to_si(self.tolerance_mrad)),
            estimator=estimator_named(self.estimator),
            error_terms=self.error_terms,
            further=self.groups if self.searched else (),
            accept=self.accept,
        )


def _comma_separated(kind: type[_Options]) -> type[_Options]:
    """Let a class's inherited options of several numbers be given as one word, e.g. ``0,3``."""
    numbers = {each.name: Numbers for each in fields(kind) if each.type == tuple[float, ...]}
    kind.__annotations__ = {**numbers, **vars(kind).get("__annotations__", {})}
    return kind


@dataclass(frozen=True)
@_comma_separated
class Effects(EffectOptions):
    """Effects of a virtual arm beside its geometry, for ``lab.simulate`` and ``lab.calibrate``; all are off by default.

    The attributes are the flags of ``lab calibrate``, with their units in their names.

    Example:
        >>> import lab
        >>> soft = lab.Effects(stiffness_nm_per_rad=1e5, payload_kg=(0.0, 3.0))
        >>> day = lab.simulate("irb120", poses=20, seed=7, effects=soft)
        >>> sorted(set(day.measurements.conditions["payload_kg"].tolist()))
        [0.0, 3.0]
    """

    own_effects: Names = ()
    """Effects that packages add, each with its options: NAME:option=number:option=number."""

    def __new__(cls, *_sizes: object, **options: object) -> "Effects":
        """Refuse an option that there is not, with a LabError that names the nearest one."""
        names = [each.name for each in fields(cls)]
        for unknown in (name for name in options if name not in names):
            nearest = "".join(f": is {each} meant? There" for each in get_close_matches(unknown, names, 1))
            raise LabError(f"lab.Effects: '{unknown}' is no option{nearest or '; there'} are {', '.join(names)}")
        return object.__new__(cls)

    def __post_init__(self) -> None:
        """Take effects as objects, too."""
        object.__setattr__(self, "own_effects", named_parts("own_effects", self.own_effects))

    @property
    def added(self) -> Mapping[str, VirtualEffect]:
        """Options of the effects that packages add, by name.

        Raises:
            LabError: there is no such effect or option, a value is no number, or an effect is given twice or
                without a size.
        """
        pairs = [own_effect_options(text) for text in self.own_effects]
        if len(found := dict(pairs)) < len(pairs):
            raise LabError("--own-effects: an effect is given twice; give it once")
        for name in set(found) & set(self.own_effects):  # named without an option
            known = [each.name for each in fields(found[name])]
            if known and not any(getattr(found[name], each) for each in known):
                raise LabError(
                    f"--own-effects {name}: its size is 0, which is no effect; give e.g. {name}:{known[0]}=1"
                )
        return found
