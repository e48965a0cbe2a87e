"""Build the link shells of the ABB IRB 120 as STL files for models/irb120.

In: the dimensions in `Arm` (mm). Out: one watertight binary STL per link (metres, in the
frame of its own MJCF body) and one for the default tool. The same bytes come out of every run.

    python scripts/build_irb120_shells.py [--out models/irb120/assets]

Kinematic lengths and overall sizes are the manufacturer's. The proportions of the castings
are estimated from the product drawing and held against the published inertia tensors, whose
radii of gyration say how far each link's mass spreads (models/irb120/README.md).
The shells are for seeing and for collision; no mass is computed from them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
import trimesh
import tyro
from shapely import Polygon
from trimesh import Trimesh

ASSETS = Path(__file__).resolve().parent.parent / "models" / "irb120" / "assets"
QUARTER = 10  # segments in a quarter circle
FILLET_STEPS = 3  # segments in a rounded edge
GRID_MM = 1e-3  # vertices snap to this, so that float32 STL neighbours stay neighbours
COLUMNS = {"x": (2, 0, 1), "y": (0, 2, 1), "z": (0, 1, 2)}  # which of outline u, v and height w is x, y, z


@dataclass(frozen=True)
class Arm:
    """Dimensions in mm. `d`: data sheet. `k`: kinematics. `e`: estimated from the product drawing."""

    foot: float = 180.0  # d, base footprint 180 x 180
    foot_height: float = 18.0  # e
    foot_hole: tuple[float, float] = (72.0, 5.5)  # e, offset from the centre, radius
    base_radius: float = 82.0  # e
    base_top: float = 166.0  # e, where the turret begins
    base_rear: float = -176.0  # e, back of the connector box
    base_rear_width: float = 136.0  # e
    base_rear_top: float = 124.0  # e
    shoulder: float = 290.0  # k, height of axis 2
    turret_radius: float = 86.0  # e
    turret_top: float = 187.0  # e
    shoulder_radius: float = 62.0  # e
    inner: float = 52.0  # e, half width of what turns between the fork's plates
    upper_arm: float = 270.0  # k, axis 2 to axis 3
    plates: tuple[float, float] = (55.0, 90.0)  # e, fork plate |y|; published rms |y| is 75.6
    plate_radii: tuple[float, float] = (68.0, 56.0)  # e, shoulder and elbow end
    cover_outer: float = 94.0  # e, |y| of the lower-arm covers
    web: tuple[float, float, float] = (34.0, 102.0, 166.0)  # e, half depth, from z, to z
    offset: float = 70.0  # k, axis 3 to axis 4
    elbow_radius: float = 52.0  # e
    housing_rear: float = -80.0  # e
    housing_front: float = 58.0  # e
    housing_top: float = 140.0  # e, 700 above the floor at home
    forearm_end: float = 134.0  # e, where link 4 begins
    forearm_radii: tuple[float, float] = (55.0, 47.0)  # e
    forearm: float = 302.0  # k, axis 4's origin to axis 5
    wrist_radii: tuple[float, float] = (46.0, 42.0)  # e
    fork_root: float = 222.0  # e, where the forearm tube becomes the wrist fork
    fork_radius: float = 35.0  # e
    slot: float = 32.0  # e, half width of the fork's slot
    slot_depth: float = 50.0  # e, from axis 5 to the slot's bottom
    fork_outer: float = 54.0  # e, |y| of the wrist side covers
    tilt: tuple[float, float, float] = (46.0, 29.5, 33.0)  # e, link 5 behind axis 5, |y|, |z|
    flange: float = 72.0  # k, axis 5 to flange face
    flange_disc: tuple[float, float] = (22.0, 13.0)  # e, radius, thickness
    flange_bolts: tuple[float, float] = (15.75, 2.5)  # e, 4 x M5 on a circle of 31.5, as in ISO 9409-1


TARGETS_MM = ((30.0, 20.0, 100.0), (-25.0, 30.0, 80.0), (0.0, -40.0, 90.0))  # the lab's default tool
REFLECTOR_MM = 6.35  # radius of a half-inch ball reflector


# --- shapes ---------------------------------------------------------------------------------


def disc(u: float, v: float, radius: float) -> Polygon:
    """A round outline centred at (u, v)."""
    return shapely.Point(u, v).buffer(radius, quad_segs=QUARTER)


def rect(u0: float, u1: float, v0: float, v1: float, corner: float) -> Polygon:
    """A rectangle u0..u1 by v0..v1 with rounded corners."""
    core = shapely.box(u0 + corner, v0 + corner, u1 - corner, v1 - corner)
    return core.buffer(corner, quad_segs=QUARTER)


def hull_of(*outlines: Polygon) -> Polygon:
    """The convex outline around several."""
    return shapely.union_all(outlines).convex_hull


def layer(outline: Polygon, height: float, axis: str) -> np.ndarray:
    """The outline's corners at `height` along `axis`, shape (n, 3)."""
    uv = shapely.get_coordinates(outline.exterior)[:-1]
    return np.column_stack([uv, np.full(len(uv), height)])[:, COLUMNS[axis]]


def prism(outline: Polygon, low: float, high: float, fillet: float, axis: str) -> Trimesh:
    """A convex outline extruded from `low` to `high` along `axis`, edges rounded by `fillet`.

    The outline's plane is (y, z) for axis x, (x, z) for axis y and (x, y) for axis z.
    """
    points = []
    for angle in np.linspace(0.0, np.pi / 2, FILLET_STEPS + 1):
        inset = outline.buffer(-fillet * (1.0 - np.sin(angle)), quad_segs=QUARTER)
        drop = fillet * (1.0 - np.cos(angle))
        points += [layer(inset, low + drop, axis), layer(inset, high - drop, axis)]
    return trimesh.convex.convex_hull(np.vstack(points))


def loft(sections: Sequence[tuple[float, Polygon]], axis: str) -> Trimesh:
    """The convex hull around outlines placed along `axis` at the given heights."""
    return trimesh.convex.convex_hull(np.vstack([layer(shape, at, axis) for at, shape in sections]))


def rod(start: Sequence[float], end: Sequence[float], radius: float) -> Trimesh:
    """A cylinder between two points."""
    return trimesh.creation.cylinder(radius, segment=np.array([start, end]), sections=2 * QUARTER)


def union(*parts: Trimesh) -> Trimesh:
    """All parts as one closed surface."""
    return trimesh.boolean.union(parts, engine="manifold")


def cut(body: Trimesh, *tools: Trimesh) -> Trimesh:
    """The body without what the tools occupy."""
    return trimesh.boolean.difference([body, *tools], engine="manifold")


def mirrored(part: Trimesh) -> tuple[Trimesh, Trimesh]:
    """The part and its mirror image in y."""
    twin = part.copy()
    twin.apply_transform(np.diag([1.0, -1.0, 1.0, 1.0]))
    return part, twin


# --- the links, each in its body's frame ----------------------------------------------------


def base(arm: Arm) -> Trimesh:
    """Foot with bolt lugs, cast column, connector box at the rear."""
    half, at = arm.foot / 2, arm.foot_hole[0]
    plate = prism(rect(-half, half, -half, half, 20.0), 0.0, arm.foot_height, 4.0, "z")
    column = loft(
        [
            (6.0, hull_of(disc(0, 0, 86.0), rect(-86.0, 0.0, -82.0, 82.0, 16.0))),
            (70.0, hull_of(disc(0, 0, arm.base_radius), rect(-78.0, 0.0, -78.0, 78.0, 20.0))),
            (arm.base_top - 20.0, disc(0, 0, arm.base_radius)),
        ],
        "z",
    )
    neck = prism(disc(0, 0, arm.base_radius - 3.0), 100.0, arm.base_top, 3.0, "z")
    collar = prism(disc(0, 0, arm.base_radius + 2.0), arm.base_top - 30.0, arm.base_top - 6.0, 4.0, "z")
    width = arm.base_rear_width / 2
    outline = hull_of(
        rect(arm.base_rear, -30.0, 4.0, arm.base_rear_top - 12.0, 10.0),
        rect(-150.0, -30.0, 4.0, arm.base_rear_top, 10.0),
    )
    box = prism(outline, -width, width, 9.0, "y")
    panel = prism(rect(-width + 14.0, width - 14.0, 22.0, 96.0, 8.0), arm.base_rear - 9.0, -150.0, 3.0, "x")
    window = prism(
        rect(-width + 19.0, width - 19.0, 27.0, 91.0, 5.0), arm.base_rear - 20.0, arm.base_rear - 3.0, 0.0, "x"
    )
    holes = [rod((x, y, -9.0), (x, y, 50.0), arm.foot_hole[1]) for x in (-at, at) for y in (-at, at)]
    pockets = [rod((x, y, 12.0), (x, y, 44.0), 14.0) for x in (at,) for y in (-at, at)]
    return cut(union(plate, column, neck, collar, box, panel), window, *holes, *pockets)


def link1(arm: Arm) -> Trimesh:
    """Round turret, neck and the shoulder barrel between the fork's plates (base frame height)."""
    low = arm.base_top + 1.5
    turret = prism(disc(0, 0, arm.turret_radius), low, arm.turret_top, 5.0, "z")
    foot = shapely.intersection(disc(0, 0, arm.turret_radius - 8.0), shapely.box(-90, -arm.inner, 90, arm.inner))
    barrel = prism(disc(0, arm.shoulder, arm.shoulder_radius), -arm.inner, arm.inner, 7.0, "y")
    neck = trimesh.convex.convex_hull(np.vstack([layer(foot, low + 8.0, "z"), barrel.vertices]))
    bearing = prism(disc(0, arm.shoulder, 44.0), -arm.inner - 2.5, arm.inner + 2.5, 1.0, "y")
    return union(turret, neck, bearing)


def link2(arm: Arm) -> Trimesh:
    """The upper arm: a fork of two rounded plates with covers, joined by a cross web."""
    (inside, outside), (low, high) = arm.plates, arm.plate_radii
    plate = prism(hull_of(disc(0, 0, low), disc(0, arm.upper_arm, high)), inside, outside, 9.0, "y")
    cover = prism(
        hull_of(disc(0, 0, low - 11.0), disc(0, arm.upper_arm, high - 11.0)), inside + 9.0, arm.cover_outer, 3.0, "y"
    )
    waist = prism(hull_of(disc(0, 112.0, 25.0), disc(0, 178.0, 21.0)), arm.cover_outer - 3.0, 110.0, 0.0, "y")
    caps = [
        prism(disc(0, at, radius), inside + 9.0, arm.cover_outer + 2.5, 2.0, "y")
        for at, radius in ((0.0, low - 24.0), (arm.upper_arm, high - 22.0))
    ]
    depth, bottom, top = arm.web
    web = prism(rect(-depth, depth, bottom, top, 14.0), -inside - 5.0, inside + 5.0, 0.0, "y")
    side = union(cut(union(plate, cover), waist), *caps)
    return union(*mirrored(side), web)


def link3(arm: Arm) -> Trimesh:
    """Elbow barrel, the housing above it, and the rear part of the forearm."""
    middle, half = arm.offset, arm.inner - 2.0
    barrel = prism(disc(0, 0, arm.elbow_radius), -arm.inner, arm.inner, 6.0, "y")
    bearing = prism(disc(0, 0, 38.0), -arm.inner - 2.5, arm.inner + 2.5, 1.0, "y")
    outline = hull_of(
        rect(arm.housing_rear, arm.housing_front, 30.0, arm.housing_top - 14.0, 22.0),
        rect(arm.housing_rear + 22.0, arm.housing_front - 16.0, 30.0, arm.housing_top, 22.0),
        disc(0, 0, arm.elbow_radius - 4.0),
    )
    housing = prism(outline, -half, half, 14.0, "y")
    cover = prism(
        rect(-half + 11.0, half - 11.0, middle - 34.0, middle + 46.0, 14.0), arm.housing_rear - 5.0, 0.0, 4.0, "x"
    )
    side = prism(
        rect(arm.housing_rear + 18.0, arm.housing_front - 14.0, middle - 22.0, middle + 52.0, 14.0),
        -half - 3.0, half + 3.0, 2.5, "y",
    )  # fmt: skip
    root, end = arm.forearm_radii
    forearm = loft(
        [(0.0, disc(0, middle, root)), (70.0, disc(0, middle, root)), (arm.forearm_end - 14.0, disc(0, middle, end))],
        "x",
    )
    collar = prism(disc(0, middle, end + 1.5), arm.forearm_end - 22.0, arm.forearm_end, 3.0, "x")
    return union(barrel, bearing, housing, cover, side, forearm, collar)


def link4(arm: Arm) -> Trimesh:
    """The turning forearm tube and the wrist fork with its side covers."""
    root, end = arm.wrist_radii
    outer, length = arm.fork_outer, arm.forearm
    tube = loft(
        [
            (arm.forearm_end + 1.5, disc(0, 0, root - 1.0)),
            (arm.forearm_end + 6.0, disc(0, 0, root)),
            (arm.fork_root, disc(0, 0, end)),
        ],
        "x",
    )
    side = hull_of(rect(arm.fork_root - 24.0, 260.0, -end + 2.0, end - 2.0, 10.0), disc(length, 0, arm.fork_radius))
    fork = prism(side, -outer + 3.0, outer - 3.0, 8.0, "y")
    covers = prism(
        hull_of(disc(arm.fork_root + 14.0, 0, 22.0), disc(length, 0, arm.fork_radius - 7.0)), -outer, outer, 3.0, "y"
    )
    blend = loft(
        [
            (arm.fork_root - 62.0, disc(0, 0, end + 1.0)),
            (arm.fork_root - 6.0, rect(-outer + 4.0, outer - 4.0, -end + 2.0, end - 2.0, 20.0)),
        ],
        "x",
    )
    reach = length + 60.0
    slot = prism(rect(length - arm.slot_depth, reach, -60.0, 60.0, 1.0), -arm.slot, arm.slot, 0.0, "y")
    return cut(union(tube, blend, fork, covers), slot)


def link5(arm: Arm) -> Trimesh:
    """The tilt body inside the wrist fork, ending in the round seat of the flange."""
    rear, half, tall = arm.tilt
    outline = hull_of(disc(-rear + tall, 0, tall), rect(0.0, 40.0, -tall, tall, 12.0))
    body = prism(outline, -half, half, 9.0, "y")
    pivot = prism(disc(0, 0, 24.0), -arm.slot - 1.0, arm.slot + 1.0, 0.0, "y")
    face = arm.flange - arm.flange_disc[1]
    seat = loft(
        [(20.0, disc(0, 0, half + 1.0)), (face - 12.0, disc(0, 0, half)), (face - 1.0, disc(0, 0, half - 6.0))], "x"
    )
    return union(body, pivot, seat)


def link6(arm: Arm) -> Trimesh:
    """The flange disc with its four threaded holes and centring bore; its face is at x = 0."""
    radius, thick = arm.flange_disc
    circle, hole = arm.flange_bolts
    plate = prism(disc(0, 0, radius), -thick, 0.0, 1.0, "x")
    angles = np.deg2rad([45.0, 135.0, 225.0, 315.0])
    holes = [
        rod((-8.0, y, z), (5.0, y, z), hole)
        for y, z in zip(circle * np.cos(angles), circle * np.sin(angles), strict=True)
    ]
    bore = rod((-6.0, 0, 0), (5.0, 0, 0), 10.0)
    return cut(plate, bore, *holes)


def tool(arm: Arm) -> Trimesh:
    """Adapter plate, post and three spokes, each ending in a cup below its reflector."""
    parts = [
        prism(disc(0, 0, arm.flange_disc[0] + 2.0), 0.0, 8.0, 1.0, "z"),
        prism(disc(0, 0, 8.0), 4.0, 74.0, 2.0, "z"),
    ]
    for x, y, z in TARGETS_MM:
        # The cup ends 4 mm below the ball's centre: a ball's upper half, and the centre, stay in sight.
        cup = prism(disc(x, y, 7.5), z - 16.0, z - 4.0, 1.0, "z")
        parts.append(cut(cup, trimesh.creation.icosphere(2, REFLECTOR_MM + 0.05).apply_translation((x, y, z))))
        parts.append(rod((0.0, 0.0, z - 26.0), (x, y, z - 12.0), 3.5))
    return union(*parts)


BUILDERS: dict[str, Callable[[Arm], Trimesh]] = {
    "base": base, "link1": link1, "link2": link2, "link3": link3,
    "link4": link4, "link5": link5, "link6": link6, "tool": tool,
}  # fmt: skip


# --- files ----------------------------------------------------------------------------------


def canonical(shell: Trimesh) -> np.ndarray:
    """The shell's triangles in metres, snapped, in an order that depends on the shape alone: (n, 3, 3)."""
    snapped = np.round(np.asarray(shell.vertices) / GRID_MM).astype(np.int64)
    corners, index = np.unique(snapped, axis=0, return_inverse=True)
    faces = index.reshape(-1)[np.asarray(shell.faces)]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    faces = faces[distinct]
    turn = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    faces = np.take_along_axis(faces, turn, axis=1)
    faces = faces[np.lexsort(faces.T[::-1])]
    return corners[faces] * (GRID_MM * 1e-3)


def stl_bytes(triangles: np.ndarray) -> bytes:
    """Binary STL of triangles (n, 3, 3); the header is constant."""
    record = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    record["normal"] = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0)
    record["corners"] = triangles
    return b"virtual calibration lab: IRB 120 shell".ljust(80) + np.uint32(len(triangles)).tobytes() + record.tobytes()


def main(out: Path = ASSETS) -> None:
    """Write every shell, and say how large it is.

    Args:
        out: folder for the STL files.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name, build in BUILDERS.items():
        triangles = canonical(build(Arm()))
        corners, faces = np.unique(triangles.reshape(-1, 3).astype(np.float32), axis=0, return_inverse=True)
        assert Trimesh(corners, faces.reshape(-1, 3), process=False).is_watertight, f"{name} leaks"
        data = stl_bytes(triangles)
        (out / f"{name}.stl").write_bytes(data)
        print(f"{name}: {len(triangles)} triangles, {len(data) / 1024:.0f} KiB")


if __name__ == "__main__":
    tyro.cli(main)
