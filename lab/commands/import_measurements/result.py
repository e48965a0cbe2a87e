"""What a merge of two files gave: typed, and as plain values."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.campaign.robot import Robot
from lab.commands.import_measurements.matching import Matching
from lab.commands.import_measurements.options import ImportOptions
from lab.commands.result import Result
from lab.commands.values import joint_values, number
from lab.core.measurements import Measurements
from lab.formats.joint_log import JointLog
from lab.formats.loose_table import LeftOut
from lab.formats.tracker_export import TrackerPoints

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from lab.render.document import Document

__all__ = ["ImportResult"]


@dataclass(frozen=True, repr=False, eq=False)
class ImportResult(Result):
    """Measurements that were merged from a tracker's and a controller's file.

    Attributes:
        options: what was asked.
        measurements: a row for each pose (m, rad, in the tracker's frame).
        points: the tracker's file.
        log: the controller's file.
        matching: how points found their poses.
    """

    options: ImportOptions
    robot: Robot
    measurements: Measurements
    points: TrackerPoints
    log: JointLog
    matching: Matching
    warnings: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0: what does not go together is refused."""
        return 0

    @property
    def left_out(self) -> tuple[LeftOut, ...]:
        """Everything of the two files that is not in the measurements, with the reason."""
        return (*self.points.left_out, *self.log.left_out, *self.matching.left_out)

    @property
    def left_out_counts(self) -> dict[str, int]:
        """How many things were left out for each reason."""
        return dict(Counter(each.why for each in self.left_out))

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        data = self.measurements
        sigma = data.sigma_m[np.isfinite(data.sigma_m)]
        return {
            "robot": self.robot.name,
            "by": self.matching.by,
            "poses": len(data),
            "points": int(data.seen.sum()),
            "targets": list(data.targets),
            "sigma_mm": number(1e3 * float(np.median(sigma))) if sigma.size else None,
            "conditions": [*data.conditions, *data.other],
            "columns": {"points": self.points.used, "joints": self.log.used},
            "columns_not_used": list(self.points.unused),
            "clocks": self._clocks(),
            "left_out": [
                {"file": each.file, "line": each.line or None, "what": each.what, "why": each.why}
                for each in self.left_out
            ],
            "warnings": list(self.warnings),
        }

    def _clocks(self) -> dict[str, Any] | None:
        """The offset of the clocks and what it does; None where points found their poses otherwise."""
        if (line := self.matching.timeline) is None:
            return None
        placed = line.placed
        return {
            "offset_s": placed.offset.seconds,
            "drift_ppm": placed.offset.drift_ppm,
            "placed": placed.placed,
            "of": len(placed.where),
            "stops": len(line.starts),
            "nominal_arm_rms_mm": None if placed.rms_m is None else 1e3 * placed.rms_m,
        }

    def document(self) -> "Document":
        """What a person reads: how many poses, which columns were taken for what, and what was left out."""
        from lab.commands.import_measurements.document import import_document

        return import_document(self)

    def columns(self) -> Mapping[str, Sequence[Any]]:
        """A row for each pose: its joints, ° or mm, and its points, mm."""
        data, chain = self.measurements, self.robot.chain
        table: dict[str, Sequence[Any]] = {"id": data.ids}
        shown = joint_values(chain.prismatic, data.joints)
        for j, (name, slides) in enumerate(zip(chain.joint_names, chain.prismatic, strict=True)):
            table[f"{name}_{'mm' if slides else 'deg'}"] = shown[:, j].tolist()
        for k, target in enumerate(data.targets):
            for i, axis in enumerate("xyz"):
                table[f"{target}_{axis}_mm"] = (1e3 * data.points[:, k, i]).tolist()
        return table

    def plot(self) -> "Figure":
        """Draw where the points are, seen from above."""
        from lab.commands.import_measurements.document import points_picture

        return points_picture(self).draw()

    def write(self, folder: Path) -> None:
        """Write ``measurements.csv``, ``config.json``, ``result.json`` and ``report.html``."""
        from lab.commands.run_folder import write_config, write_json
        from lab.formats.measurement_csv import write_measurements

        write_measurements(folder / "measurements.csv", self.measurements, self.robot.chain.prismatic)
        write_config(folder, "import", self.options, self.robot.sha256)
        write_json(folder / "result.json", self.to_dict())
        self.report(folder / "report.html")
