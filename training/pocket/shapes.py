# ruff: noqa: RUF005  (array + list is addition here)
"""Procedural training shapes: compounds of signed distance primitives, sphere-traced into small g-buffers.

No mesh is read anywhere: animals, figures, vessels, furniture, trees, tools and blobs come from a few recipes.
A shape lives in the package's normalised space (bounding box centred at the origin, longest edge 2, +Y up, front +Z).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from paintit.render.camera import Cameras, look_at

#: What a primitive is of the whole; materials may colour parts apart.
BODY, HEAD, LIMB, ACCENT, TOP = range(5)
FOV = math.radians(45.0)


@dataclass
class Primitive:
    """One signed distance primitive: kind, centre, rotation (rows: local axes), sizes, and the part it belongs to."""

    kind: str
    center: np.ndarray
    size: np.ndarray
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    part: int = BODY
    end: np.ndarray | None = None
    profile: np.ndarray | None = None


@dataclass
class Shape:
    """Primitives joined by a smooth union of width ``blend``; ``waves`` displace the surface."""

    archetype: str
    primitives: list[Primitive]
    blend: float = 0.06
    waves: np.ndarray | None = None
    wave_height: float = 0.0
    shift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    scale: float = 1.0

    def distance(self, points: Tensor) -> tuple[Tensor, Tensor]:
        """Signed distance (n,) and part (n,) at normalised ``points`` (n, 3)."""
        p = points / self.scale + torch.as_tensor(self.shift, dtype=torch.float32)
        total, part, least = None, None, None
        for primitive in self.primitives:
            d = _distance(primitive, p)
            if total is None or part is None or least is None:
                total, least, part = d, d, torch.full(d.shape, primitive.part, dtype=torch.int64)
                continue
            part = torch.where(d < least, primitive.part, part)
            least = torch.minimum(least, d)
            h = (self.blend - (total - d).abs()).clamp_min(0) / self.blend
            total = torch.minimum(total, d) - h * h * (self.blend / 4)
        assert total is not None
        assert part is not None
        if self.waves is not None:
            w = torch.as_tensor(self.waves, dtype=torch.float32)
            total = total + self.wave_height * torch.sin(p @ w[:, :3].T + w[:, 3]).prod(-1)
        return total * self.scale, part


def _distance(primitive: Primitive, points: Tensor) -> Tensor:
    q = points - torch.as_tensor(primitive.center, dtype=torch.float32)
    s = [float(v) for v in primitive.size]
    if primitive.kind == "capsule":  # round cone from center to end, radii s[0] and s[1]
        assert primitive.end is not None
        axis = torch.as_tensor(primitive.end - primitive.center, dtype=torch.float32)
        t = ((q @ axis) / (axis @ axis).clamp_min(1e-6)).clamp(0, 1)
        return (q - t[:, None] * axis).norm(dim=-1) - (s[0] + (s[1] - s[0]) * t)
    if not np.array_equal(primitive.rotation, np.eye(3)):
        q = q @ torch.as_tensor(primitive.rotation, dtype=torch.float32).T
    if primitive.kind == "ellipsoid":
        r = torch.tensor(s)
        k0, k1 = (q / r).norm(dim=-1), (q / (r * r)).norm(dim=-1).clamp_min(1e-6)
        return k0 * (k0 - 1) / k1
    if primitive.kind == "box":  # s[:3] half sizes, s[3] rounding
        d = q.abs() - torch.tensor(s[:3]) + s[3]
        return d.clamp_min(0).norm(dim=-1) + d.amax(-1).clamp_max(0) - s[3]
    radial = (q[:, 0] ** 2 + q[:, 2] ** 2).sqrt()
    if primitive.kind == "torus":  # about local y
        return ((radial - s[0]) ** 2 + q[:, 1] ** 2).sqrt() - s[1]
    if primitive.kind == "cylinder":  # radius s[0], half height s[1], rounding s[2]
        d = torch.stack([radial - s[0], q[:, 1].abs() - s[1]], -1) + s[2]
        return d.clamp_min(0).norm(dim=-1) + d.amax(-1).clamp_max(0) - s[2]
    if primitive.kind == "lathe":  # radius by a table over y in [-1, 1] * s[0]
        assert primitive.profile is not None
        table = torch.as_tensor(primitive.profile, dtype=torch.float32)
        u = ((q[:, 1] / s[0] + 1) / 2 * (len(table) - 1)).clamp(0, len(table) - 1.001)
        low = u.floor().long()
        r = torch.lerp(table[low], table[low + 1], u - low)
        return 0.6 * torch.maximum(radial - r, q[:, 1].abs() - s[0])
    raise ValueError(primitive.kind)


def random_rotation(rng: np.random.Generator) -> np.ndarray:
    """Uniform random rotation matrix (3, 3)."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def _capsule(a, b, r0: float, r1: float, part: int = LIMB) -> Primitive:
    return Primitive("capsule", np.asarray(a, float), np.array([r0, r1]), part=part, end=np.asarray(b, float))


def _ellipsoid(c, r, part: int = BODY, rotation: np.ndarray | None = None) -> Primitive:
    return Primitive(
        "ellipsoid", np.asarray(c, float), np.asarray(r, float), np.eye(3) if rotation is None else rotation, part
    )


def _box(c, half, rounding: float, part: int = BODY, rotation: np.ndarray | None = None) -> Primitive:
    return Primitive(
        "box", np.asarray(c, float), np.array([*half, rounding]), np.eye(3) if rotation is None else rotation, part
    )


def _cylinder(c, radius: float, half: float, part: int = BODY, rotation: np.ndarray | None = None) -> Primitive:
    rotation = np.eye(3) if rotation is None else rotation
    return Primitive("cylinder", np.asarray(c, float), np.array([radius, half, 0.03]), rotation, part)


def _lie(axis: int) -> np.ndarray:
    """Rotation that turns local y onto world axis 0 or 2."""
    return (
        np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]) if axis == 0 else np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    )


def quadruped(rng: np.random.Generator) -> Shape:
    """Body along z, four legs, neck, head, snout, ears or horns, tail."""
    u = rng.uniform
    length, thick, leg = u(0.5, 0.9), u(0.22, 0.42), u(0.25, 0.7)
    parts = [_ellipsoid([0, 0, 0], [thick, thick * u(0.85, 1.2), length])]
    for side in (-1, 1):
        for end in (-0.65, 0.65):
            hip = np.array([side * thick * 0.55, -thick * 0.4, end * length])
            foot = hip + [side * u(0, 0.05), -leg - thick * 0.4, u(-0.05, 0.05)]
            parts.append(_capsule(hip, foot, u(0.1, 0.17), u(0.06, 0.11)))
    head = np.array([0, thick * u(0.4, 1.6), length * u(1.0, 1.3)])
    size = u(0.2, 0.34)
    parts += [
        _capsule([0, thick * 0.3, length * 0.7], head, thick * 0.6, size * 0.7, BODY),
        _ellipsoid(head, [size, size, size * u(0.9, 1.3)], HEAD),
        _ellipsoid(
            head + [0, -0.3 * size, size],
            [size * 0.55, size * 0.5, size * u(0.4, 1.0)],
            ACCENT if rng.random() < 0.3 else HEAD,
        ),
    ]
    height, spread = u(0.7, 1.6), u(0.5, 0.9)
    for side in (-1, 1):
        ear = head + [side * size * spread, size * 0.6, 0]
        parts.append(
            _ellipsoid(
                ear + [side * 0.05, size * height * 0.3, 0],
                [size * 0.3, size * height * 0.5, size * 0.2],
                ACCENT if rng.random() < 0.3 else HEAD,
            )
        )
    tail = np.array([0, u(-0.3, 0.5), -length - u(0.2, 0.6)])
    parts.append(_capsule([0, thick * 0.4, -length * 0.9], tail, u(0.04, 0.1), u(0.03, 0.16)))
    return Shape("quadruped", parts, u(0.04, 0.12))


def figure(rng: np.random.Generator) -> Shape:
    """Standing figure with arms at an angle; sometimes a hat."""
    u = rng.uniform
    wide, arm = u(0.16, 0.3), u(0.2, 1.4)
    parts = [
        _capsule([0, 0, 0], [0, 0.5, 0], wide, wide * u(0.9, 1.2), BODY),
        _ellipsoid([0, 0.85 + wide * 0.4, 0.02], [u(0.13, 0.24)] * 3, HEAD),
    ]
    for side in (-1, 1):
        shoulder = np.array([side * wide, 0.52, 0])
        elbow = shoulder + 0.35 * np.array([side * math.sin(arm), -math.cos(arm), u(-0.2, 0.3)])
        hand = elbow + 0.35 * np.array([side * math.sin(arm * 0.8), -math.cos(arm * 0.8), u(-0.1, 0.5)])
        parts += [
            _capsule(shoulder, elbow, u(0.08, 0.12), 0.07),
            _capsule(elbow, hand, 0.075, 0.06),
            _capsule([side * wide * 0.55, -0.05, 0], [side * wide * u(0.6, 1), -0.95, u(-0.1, 0.1)], 0.14, 0.08),
            _ellipsoid([side * wide * 0.8, -0.98, 0.06], [0.08, 0.06, 0.15], ACCENT),
        ]
    if rng.random() < 0.4:
        parts.append(_cylinder([0, 1.0 + wide * 0.4, 0], u(0.18, 0.35), u(0.02, 0.12), TOP))
    return Shape("figure", parts, u(0.03, 0.08))


def bird(rng: np.random.Generator) -> Shape:
    """Egg body, round head, beak, wings, tail."""
    u = rng.uniform
    body = np.array([u(0.4, 0.6), u(0.4, 0.6), u(0.55, 0.9)])
    head = np.array([0, body[1] + u(0.05, 0.3), body[2] * u(0.4, 0.9)])
    r = u(0.22, 0.36)
    parts = [
        _ellipsoid([0, 0, 0], body),
        _ellipsoid(head, [r, r, r], HEAD),
        _ellipsoid(head + [0, -0.1 * r, r * 1.1], [r * 0.45, r * 0.25, r * u(0.4, 0.9)], ACCENT),
        _ellipsoid([0, body[1] * 0.5, -body[2] * 1.05], [0.2, 0.08, 0.3]),
    ]
    for side in (-1, 1):
        parts.append(_ellipsoid([side * body[0] * 0.9, 0.05, -0.1], [0.1, body[1] * 0.6, body[2] * 0.6], LIMB))
    if rng.random() < 0.4:
        parts += [
            _capsule([s * 0.15, -body[1] * 0.8, 0], [s * 0.18, -body[1] - 0.35, 0], 0.05, 0.05, ACCENT) for s in (-1, 1)
        ]
    return Shape("bird", parts, u(0.03, 0.1))


def vessel(rng: np.random.Generator) -> Shape:
    """Turned body with optional handle, spout and lid."""
    u = rng.uniform
    knots = u(0.25, 0.9, size=rng.integers(3, 7))
    table = np.interp(np.linspace(0, 1, 33), np.linspace(0, 1, len(knots)), knots)
    table = np.convolve(np.pad(table, 4, mode="edge"), np.hanning(9) / np.hanning(9).sum(), "valid")
    table = np.minimum(table, 0.25 + 6 * np.linspace(0, 1, 33))
    half = u(0.5, 1.3)
    parts = [Primitive("lathe", np.zeros(3), np.array([half]), profile=table)]
    r = float(table[16])
    if rng.random() < 0.5:
        parts.append(
            Primitive(
                "torus",
                np.array([r + 0.1, u(-0.2, 0.2), 0]),
                np.array([u(0.2, 0.4), u(0.04, 0.08)]),
                np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
                LIMB,
            )
        )
    if rng.random() < 0.4:
        parts.append(_capsule([-r * 0.7, -0.1 * half, 0], [-r - 0.45, half * u(0.3, 0.9), 0], 0.14, 0.07, LIMB))
    if rng.random() < 0.4:
        parts += [
            _ellipsoid([0, half, 0], [table[-1] * 0.9, 0.12, table[-1] * 0.9], TOP),
            _ellipsoid([0, half + 0.15, 0], [0.09, 0.09, 0.09], ACCENT),
        ]
    return Shape("vessel", parts, 0.04)


def furniture(rng: np.random.Generator) -> Shape:
    """Seat or table top on legs, with an optional back."""
    u = rng.uniform
    x, z, leg = u(0.4, 0.9), u(0.4, 0.7), u(0.3, 0.9)
    parts = [_box([0, 0, 0], [x, u(0.04, 0.2), z], 0.04)]
    thick = u(0.04, 0.1)
    parts += [
        _box([sx * (x - 0.1), -leg / 2 - 0.05, sz * (z - 0.1)], [thick, leg / 2 + 0.05, thick], 0.02, LIMB)
        for sx in (-1, 1)
        for sz in (-1, 1)
    ]
    if rng.random() < 0.6:
        parts.append(_box([0, 0.5, -z + 0.08], [x, u(0.4, 0.7), u(0.05, 0.15)], 0.04, TOP))
    if rng.random() < 0.3:
        parts += [_box([s * x, 0.2, 0], [0.07, 0.15, z], 0.04, TOP) for s in (-1, 1)]
    return Shape("furniture", parts, 0.03)


def plant(rng: np.random.Generator) -> Shape:
    """Trunk with blobs of leaves, or a pot with a plant."""
    u = rng.uniform
    parts = [_capsule([0, -1, 0], [u(-0.1, 0.1), 0.3, 0], u(0.1, 0.25), 0.1, LIMB)]
    parts += [
        _ellipsoid([u(-0.4, 0.4), u(0.1, 0.9), u(-0.4, 0.4)], u(0.25, 0.55, 3), TOP) for _ in range(rng.integers(2, 5))
    ]
    return Shape("plant", parts, 0.08, _waves(rng, 5, 9), u(0, 0.03))


def vehicle(rng: np.random.Generator) -> Shape:
    """Body, cabin and wheels."""
    u = rng.uniform
    x, y, z = u(0.35, 0.5), u(0.15, 0.3), u(0.8, 1.1)
    parts = [
        _box([0, 0, 0], [x, y, z], u(0.05, 0.14)),
        _box([0, y + 0.15, -0.1], [x * 0.85, 0.2, z * u(0.3, 0.6)], 0.12, TOP),
    ]
    parts += [
        _cylinder([sx * x, -y, sz * z * 0.6], u(0.18, 0.28), 0.09, ACCENT, _lie(0)) for sx in (-1, 1) for sz in (-1, 1)
    ]
    return Shape("vehicle", parts, 0.03)


def headgear(rng: np.random.Generator) -> Shape:
    """Dome with ear flaps or a brim, sometimes on a stand."""
    u = rng.uniform
    r = u(0.5, 0.7)
    parts = [_ellipsoid([0, 0.3, 0], [r, r * u(0.9, 1.1), r * u(1, 1.25)])]
    if rng.random() < 0.5:
        parts += [_ellipsoid([s * r * 0.9, 0, 0], [0.14, 0.35, 0.3], BODY) for s in (-1, 1)]
    else:
        parts.append(_cylinder([0, 0.05, 0], r * u(1.1, 1.5), 0.04, LIMB))
    if rng.random() < 0.6:
        parts += [_cylinder([s * 0.22, 0.45, r * 1.05], 0.18, 0.08, ACCENT, _lie(2)) for s in (-1, 1)]
    if rng.random() < 0.5:
        parts += [_cylinder([0, -0.45, 0], 0.09, 0.4, LIMB), _cylinder([0, -0.85, 0], u(0.3, 0.5), 0.06, LIMB)]
    return Shape("headgear", parts, 0.04)


def tool(rng: np.random.Generator) -> Shape:
    """Rings, plates, rods and wings, as hardware is made of."""
    u = rng.uniform
    parts = [_cylinder([0, 0, 0], u(0.2, 0.5), u(0.1, 0.5))]
    for _ in range(rng.integers(1, 4)):
        kind = rng.integers(4)
        at = u(-0.5, 0.5, 3)
        if kind == 0:
            parts.append(_ellipsoid(at, u(0.08, 0.5, 3), LIMB, random_rotation(rng)))
        elif kind == 1:
            parts.append(Primitive("torus", at, np.array([u(0.25, 0.5), u(0.06, 0.14)]), random_rotation(rng), LIMB))
        elif kind == 2:
            parts.append(_capsule(at, -at + u(-0.5, 0.5, 3), u(0.06, 0.15), u(0.06, 0.15)))
        else:
            parts.append(_box(at, u(0.06, 0.5, 3), 0.02, LIMB, random_rotation(rng)))
    return Shape("tool", parts, u(0.02, 0.06))


def blob(rng: np.random.Generator) -> Shape:
    """Displaced ellipsoids."""
    parts = [
        _ellipsoid(rng.uniform(-0.3, 0.3, 3), rng.uniform(0.35, 0.9, 3), BODY, random_rotation(rng))
        for _ in range(rng.integers(1, 4))
    ]
    return Shape("blob", parts, 0.2, _waves(rng, 2, 8), rng.uniform(0, 0.08))


def simple(rng: np.random.Generator) -> Shape:
    """One primitive, upright or turned: ball, egg, block, ring, rod, drum."""
    u = rng.uniform
    rotation = random_rotation(rng) if rng.random() < 0.5 else np.eye(3)
    kind = rng.integers(6)
    if kind == 0:
        return Shape("ball", [_ellipsoid([0, 0, 0], [1, 1, 1])])
    if kind == 1:
        return Shape("ball", [_ellipsoid([0, 0, 0], u(0.5, 1, 3), BODY, rotation)])
    if kind == 2:
        return Shape("block", [_box([0, 0, 0], u(0.4, 1, 3), u(0.01, 0.2), BODY, rotation)])
    if kind == 3:
        return Shape("ring", [Primitive("torus", np.zeros(3), np.array([u(0.5, 0.75), u(0.12, 0.35)]), rotation)])
    if kind == 4:
        return Shape("block", [_cylinder([0, 0, 0], u(0.3, 0.9), u(0.1, 1), BODY, rotation)])
    return Shape(
        "vessel",
        [
            Primitive(
                "lathe", np.zeros(3), np.array([u(0.4, 1)]), rotation, profile=np.linspace(u(0.5, 1), u(0.02, 0.5), 9)
            )
        ],
    )


def compound(rng: np.random.Generator) -> Shape:
    """Two to five random primitives near one another."""
    parts = []
    for i in range(rng.integers(2, 6)):
        one = simple(rng).primitives[0]
        one.size = one.size * rng.uniform(0.4, 0.8)
        if one.profile is not None:
            one.profile = one.profile * 0.6
        one.center = rng.uniform(-0.5, 0.5, 3)
        one.part = (BODY, LIMB, TOP, HEAD, ACCENT)[i % 5]
        parts.append(one)
    return Shape("compound", parts, rng.uniform(0.02, 0.2))


def _waves(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """(2, 4) wave vectors and phases."""
    direction = rng.normal(size=(2, 3))
    direction *= rng.uniform(low, high) / np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.concatenate([direction, rng.uniform(0, 2 * math.pi, (2, 1))], 1)


RECIPES = (
    quadruped,
    quadruped,
    figure,
    bird,
    vessel,
    vessel,
    furniture,
    plant,
    vehicle,
    headgear,
    tool,
    blob,
    simple,
    simple,
    compound,
)


def random_shape(rng: np.random.Generator) -> Shape:
    """A random recipe, moved and scaled so that its bounding box is centred and its longest edge is 2."""
    shape = RECIPES[rng.integers(len(RECIPES))](rng)
    if rng.random() < 0.2 and shape.waves is None:
        shape.waves, shape.wave_height = _waves(rng, 6, 16), float(rng.uniform(0, 0.03))
    axis = torch.linspace(-2, 2, 40)
    grid = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    inside = grid[shape.distance(grid)[0] < 0.03]
    low, high = inside.amin(0), inside.amax(0)
    shape.shift = ((low + high) / 2).double().numpy()
    shape.scale = float(2 / (high - low).max().clamp_min(0.2))
    return shape


@dataclass
class Buffers:
    """What the materials need of v views of one shape, (v, h, w, ...)."""

    mask: Tensor
    position: Tensor
    normal: Tensor
    part: Tensor
    eye: Tensor
    frame: Tensor
    archetype: str
    curvature: Tensor


#: Step over which mean curvature is measured, and the curvature (1 / length) that counts as 1.
CURVATURE_STEP, CURVATURE_UNIT = 0.03, 20.0


def trace(shape: Shape, cameras: Cameras, size: int = 64) -> Buffers:
    """Sphere-trace a shape from every camera; rays that leave the sphere of radius 1.8 are misses."""
    origin, direction = (r.reshape(-1, 3) for r in cameras.rays(size, size))
    n = origin.shape[0]
    middle = -(origin * direction).sum(-1)
    chord = 1.8**2 - ((origin + middle[:, None] * direction) ** 2).sum(-1)
    t = (middle - chord.clamp_min(0).sqrt()).clamp_min(0.02)
    far = middle + chord.clamp_min(0).sqrt()
    alive = (chord > 0).nonzero()[:, 0]
    hit = torch.zeros(n, dtype=torch.bool)
    for step in range(56):
        if step % 4 == 0:
            alive = alive[(t[alive] < far[alive]) & ~hit[alive]]
            if not len(alive):
                break
        d, _ = shape.distance(origin[alive] + t[alive, None] * direction[alive])
        hit[alive] = d < 0.004
        t[alive] += torch.where(d < 0.004, 0.0, 0.9 * d.clamp_min(0.004))
    index = hit.nonzero()[:, 0]
    position, normal, part = torch.zeros(n, 3), torch.zeros(n, 3), torch.zeros(n, dtype=torch.uint8)
    p = origin[index] + t[index, None] * direction[index]
    corners = torch.tensor([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    gradient = torch.zeros_like(p)
    for corner in corners:
        gradient += corner * shape.distance(p + 0.008 * corner)[0][:, None]
    facing = torch.nn.functional.normalize(gradient, dim=-1)
    facing = torch.where((facing * direction[index]).sum(-1, keepdim=True) > 0, -facing, facing)
    position[index], normal[index] = p, facing
    middle_distance, nearest = shape.distance(p)
    part[index] = nearest.to(torch.uint8)
    laplacian = -4 * middle_distance  # of the distance: the sum of the two principal curvatures, positive where convex
    for corner in corners:
        laplacian += shape.distance(p + CURVATURE_STEP * corner)[0]
    curvature = torch.zeros(n)
    curvature[index] = (laplacian / (2 * CURVATURE_STEP**2 * CURVATURE_UNIT)).clamp(-1, 1)
    grid = (len(cameras), size, size)
    return Buffers(
        hit.reshape(grid),
        position.reshape(*grid, 3),
        normal.reshape(*grid, 3),
        part.reshape(grid),
        cameras.eye,
        torch.stack(cameras.frame(), 1),
        shape.archetype,
        curvature.reshape(grid),
    )


#: Close-ups stand this far from a point of the surface, off its normal by up to this angle.
CLOSE_UP_DISTANCE, CLOSE_UP_TILT_DEG = (0.6, 2.0), 35.0


def random_cameras(views: int, rng: np.random.Generator) -> Cameras:
    """Views of the whole as the paint loop's: elevation and azimuth uniform."""
    return _cameras([((0.0, 0.0, 0.0), rng.uniform(0, 360), rng.uniform(-60, 60), 3.25) for _ in range(views)])


def close_up_cameras(shape: Shape, whole: Buffers, views: int, rng: np.random.Generator) -> Cameras:
    """Views along the normal of points that the views of the ``whole`` saw, from outside the shape."""
    points, normals = whole.position[whole.mask], whole.normal[whole.mask]
    chosen = []
    for _ in range(20 * views):
        if len(chosen) == views or not len(points):
            break
        i = int(rng.integers(len(points)))
        x, y, z = normals[i].tolist()
        tilt = rng.uniform(-CLOSE_UP_TILT_DEG, CLOSE_UP_TILT_DEG, 2)
        azimuth = math.degrees(math.atan2(x, z)) + tilt[0]
        elevation = float(np.clip(math.degrees(math.asin(min(max(y, -1), 1))) + tilt[1], -60, 60))
        camera = (tuple(points[i].tolist()), azimuth, elevation, float(rng.uniform(*CLOSE_UP_DISTANCE)))
        if float(shape.distance(_cameras([camera]).eye)[0]) > 0.1:
            chosen.append(camera)
    return _cameras(chosen) if chosen else random_cameras(views, rng)


def _cameras(views: list) -> Cameras:
    """Cameras from (target, azimuth in degrees, elevation in degrees, distance)."""
    radians = lambda degrees: torch.tensor([math.radians(degrees)], dtype=torch.float32)  # noqa: E731
    many = [look_at(radians(a), radians(e), r, FOV, target) for target, a, e, r in views]
    cat = lambda name: torch.cat([getattr(c, name) for c in many])  # noqa: E731
    return Cameras(cat("eye"), cat("target"), cat("azimuth"), cat("elevation"), FOV)
