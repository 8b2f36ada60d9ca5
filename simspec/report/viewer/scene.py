"""The live scene: a world in a viser server, with switchable groups, and sliders that move its joints."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from simspec.errors import visible
from simspec.meshes.drawn import surfaces as surfaces_of
from simspec.report.page.shapes import is_drawn, painted
from simspec.report.viewer import drawn
from simspec.world import frames
from simspec.world.posture import followers, initial_positions, joint_frame, poses_at, with_followers
from simspec.world.rotations import exponential_of, logarithm_of
from simspec.world.types import Body, Joint, Pose, Shape, World

GROUPS: Final = ("bodies", "collision shapes", "frames", "joints", "contact pairs", "loads", "names")
SHOWN_FIRST: Final = ("bodies", "joints", "loads")
MOST_SLIDERS: Final = 120
"""Sliders of a scene; the joints after them stay at their initial positions."""
MOST_LAWS: Final = 12
"""Laws of pairs of materials that are listed."""
MOST_CHOICES: Final = 1_000
"""Bodies that can be chosen for their numbers."""
RIGHT_OF_SCENE: Final = 0.35
"""How far right of the scene the camera looks, of its radius: the controls are there."""
DIGITS: Final = 3
"""Of the numbers of sliders."""
SLIDER_STEP: Final = 0.001
"""Of sliders (rad, m)."""
AXIS_COLOUR: Final = (0, 114, 178)
LIMIT_COLOUR: Final = (213, 94, 0)
CONTACT_COLOUR: Final = (204, 121, 167)
COLLISION_COLOUR: Final = (0, 158, 115)
GRID_COLOUR: Final = (150, 150, 145)
FORCE_COLOUR: Final = (230, 159, 0)
TORQUE_COLOUR: Final = (86, 180, 233)
UNITS: Final = {"hinge": "rad", "slide": "m", "ball": "rad"}


@dataclass(frozen=True)
class SliderRange:
    """A slider of a joint: which of its numbers, their range, and the label."""

    joint: Joint
    part: int
    label: str
    low: float
    high: float
    start: float


def slider_ranges(world: World, radius: float) -> list[SliderRange]:
    """The sliders of a world: one for each hinge and slide that follows no other joint, three for each ball joint (a rotation
    vector). A range without limits is half a turn each way, or twice the radius of the scene."""
    coupled, found = followers(world), []
    for body in world.bodies:
        joint = body.joint
        if joint.kind not in UNITS or joint.name in coupled:
            continue
        name = f"{visible(joint.name)} ({UNITS[joint.kind]})"
        if joint.kind == "ball":
            parts = list(enumerate(slider_values(joint, joint.position)))
            reach = max(
                math.pi if joint.angle_limit is None else joint.angle_limit, *(abs(start) for _, start in parts)
            )
            found += [SliderRange(joint, part, f"{name} {'xyz'[part]}", -reach, reach, start) for part, start in parts]
            continue
        free = math.pi if joint.kind == "hinge" else 2.0 * radius
        (start,) = joint.position
        low, high = joint.position_limits or (start - free, start + free)
        found.append(SliderRange(joint, 0, name, min(low, start), max(high, start), start))
    return found


def slider_values(joint: Joint, position: Sequence[float]) -> tuple[float, ...]:
    """The numbers that the sliders of a joint show."""
    return tuple(logarithm_of(position)) if joint.kind == "ball" else tuple(position)


def joint_position(joint: Joint, values: Sequence[float]) -> tuple[float, ...]:
    """The position of a joint whose sliders show ``values``."""
    return tuple(exponential_of(values)) if joint.kind == "ball" else tuple(values)


@dataclass
class Placed:
    """A node of the scene, and the function that gives its pose when bodies have moved; None: it stays in its parent."""

    node: Any
    pose: Callable[[dict[str, Pose]], Pose] | None = None


@dataclass
class LiveScene:
    """A world in a viser server. Methods may be called from the server's threads."""

    server: Any
    world: World
    positions: dict[str, tuple[float, ...]] = field(init=False)
    placed: dict[str, Pose] = field(init=False)

    def __post_init__(self) -> None:
        self.extent = drawn.extent(self.world)
        self.length = drawn.axis_length(self.world, self.extent.radius)
        self.positions = initial_positions(self.world)
        self.placed = poses_at(self.world, self.positions)
        self._lock = threading.RLock()
        self._groups: dict[str, list[Placed]] = {}
        self._shown: set[str] = set()
        self._solids = drawn.solids(self.world)
        self._sliders: list[tuple[SliderRange, Any]] = []
        self._bodies = {body.name: self._node(f"/world/{_path(body.name)}", body.name) for body in self.world.bodies}
        self._look()
        self._controls()

    # --- what is moved --------------------------------------------------------------------------------------------------

    def move(self, positions: dict[str, tuple[float, ...]]) -> None:
        """Place joints, those that follow them, and all bodies. Other joints stay."""
        with self._lock:
            self.positions = with_followers(self.world, {**self.positions, **positions})
            self.placed = poses_at(self.world, self.positions)
            self._refresh()

    def _refresh(self) -> None:
        """Put every node where the bodies are now."""
        moving = [*self._bodies.values(), *(entry for group in self._groups.values() for entry in group)]
        with self.server.atomic():
            for entry in moving:
                if entry.pose is not None:
                    pose = entry.pose(self.placed)
                    entry.node.position, entry.node.wxyz = pose.position, pose.quaternion
            if "contact pairs" in self._shown:
                self._draw_contact()
        self._show_body()

    def show(self, group: str, on: bool) -> None:
        """Switch a group of :data:`GROUPS` on or off; its nodes are made when it is first shown."""
        with self._lock, self.server.atomic():
            (self._shown.add if on else self._shown.discard)(group)
            if group == "contact pairs":
                self._draw_contact()
                return
            if on and group not in self._groups:
                self._groups[group] = self._makers()[group]()
            for entry in self._groups.get(group, ()):
                entry.node.visible = on

    def _makers(self) -> dict[str, Callable[[], list[Placed]]]:
        return {
            "bodies": self._visual,
            "collision shapes": self._collision,
            "frames": self._frames,
            "joints": self._joints,
            "loads": self._loads,
            "names": self._names,
        }

    # --- what is drawn --------------------------------------------------------------------------------------------------

    def _node(self, path: str, body: str) -> Placed:
        at = self.placed[body]
        node = self.server.scene.add_frame(path, show_axes=False, position=at.position, wxyz=at.quaternion)
        return Placed(node, lambda placed: placed[body])

    def _visual(self) -> list[Placed]:
        surfaces, made = surfaces_of(self.world), []
        for body in painted(self.world).bodies:
            for index, part in enumerate(drawn.visual_parts(body, surfaces)):
                path = f"/world/{_path(body.name)}/visual {index}"
                if part.mesh is None:
                    made.append(self._plane(path, part.shape, GRID_COLOUR))
                    continue
                red, green, blue, opacity = part.colour
                node = self.server.scene.add_mesh_simple(
                    path,
                    *part.mesh,
                    color=tuple(round(255 * share) for share in (red, green, blue)),
                    opacity=None if opacity >= 1.0 else opacity,
                    flat_shading=part.flat,
                    side="double",
                    position=part.pose.position,
                    wxyz=part.pose.quaternion,
                )
                made.append(Placed(node))
        return made

    def _collision(self) -> list[Placed]:
        made = []
        for body in self.world.bodies:
            for index, shape in enumerate(body.shapes):
                path = f"/world/{_path(body.name)}/collision {index}"
                if not (shape.collision and is_drawn(shape)):
                    continue
                if (mesh := drawn.triangles(shape)) is None:
                    made.append(self._plane(path, shape, COLLISION_COLOUR))
                    continue
                place = {"position": shape.pose.position, "wxyz": shape.pose.quaternion}
                node = self.server.scene.add_mesh_simple(path, *mesh, color=COLLISION_COLOUR, wireframe=True, **place)
                made.append(Placed(node))
        return made

    def _plane(self, path: str, shape: Shape, colour: tuple[int, int, int]) -> Placed:
        side, cell = 8.0 * self.extent.radius, 10.0 ** math.floor(math.log10(self.extent.radius))
        grid = {"cell_size": cell, "section_size": 5.0 * cell, "cell_color": colour, "section_color": colour}
        place = {"position": shape.pose.position, "wxyz": shape.pose.quaternion}
        return Placed(self.server.scene.add_grid(path, side, side, **grid, **place))

    def _frames(self) -> list[Placed]:
        size = {"axes_length": 0.7 * self.length, "axes_radius": 0.025 * self.length}
        made = [
            Placed(self.server.scene.add_frame(f"/world/{_path(body.name)}/frame", **size))
            for body in drawn.named_bodies(self.world)
        ]
        for frame in self.world.frames:
            place = {"position": frame.pose.position, "wxyz": frame.pose.quaternion}
            path = f"/world/{_path(frame.body)}/frame {_path(frame.name)}"
            made.append(Placed(self.server.scene.add_frame(path, **size, **place)))
        return made

    def _joints(self) -> list[Placed]:
        made: list[Placed] = []
        for body in self.world.bodies:
            joint = body.joint
            if joint.kind not in UNITS:
                continue
            at = self._joint_frame(body)(self.placed)
            base = f"/joints/{_path(joint.name)}"
            node = self.server.scene.add_frame(base, show_axes=False, position=at.position, wxyz=at.quaternion)
            made.append(Placed(node, self._joint_frame(body)))
            made += self._joint_marks(base, body)
        return made

    def _joint_marks(self, base: str, body: Body) -> list[Placed]:
        """Axis and range in the joint's frame, the pointer in the body's; of a ball joint its centre."""
        scene, joint, length = self.server.scene, body.joint, self.length
        if joint.kind == "ball":
            ball = scene.add_icosphere(f"{base}/centre", radius=0.12 * length, color=AXIS_COLOUR)
            return [Placed(ball)]
        size = {"shaft_radius": 0.02 * length, "head_radius": 0.06 * length, "head_length": 0.18 * length}
        axis = np.multiply(joint.axis, length)
        made = [Placed(scene.add_arrows(f"{base}/axis", np.array([[-0.5 * axis, axis]]), AXIS_COLOUR, **size))]
        lines = (
            (f"{base}/range", drawn.limits_line(joint, length), LIMIT_COLOUR if joint.position_limits else AXIS_COLOUR),
        )
        pointer = (f"/world/{_path(body.name)}/pointer", drawn.pointer_line(joint, length), AXIS_COLOUR)
        for path, segments, colour in (*lines, pointer):
            if len(segments):
                made.append(
                    Placed(scene.add_line_segments(path, segments, colour, thickness=2.0, thickness_units="screen"))
                )
        return made

    def _joint_frame(self, body: Body) -> Callable[[dict[str, Pose]], Pose]:
        return lambda placed: joint_frame(placed, body.joint.parent, body.joint.origin)

    def _draw_contact(self) -> None:
        reach = drawn.NEAR * self.extent.radius
        on = "contact pairs" in self._shown
        pairs = drawn.near_pairs(self.world, self._solids, self.placed, reach) if on else np.zeros((0, 2, 3))
        count = f"the nearest {len(pairs)}" if len(pairs) == drawn.MOST_NEAR else f"{len(pairs)} near each other"
        self._near.value = count if on else "not shown"
        lines = pairs if len(pairs) else np.zeros((1, 2, 3))
        self.server.scene.add_line_segments(
            "/contact pairs", lines, CONTACT_COLOUR, thickness=3.0, thickness_units="screen", visible=bool(len(pairs))
        )

    def _loads(self) -> list[Placed]:
        made: list[Placed] = []
        radius = self.extent.radius
        size = {"shaft_radius": 0.012 * radius, "head_radius": 0.035 * radius, "head_length": 0.09 * radius}
        for index, load in enumerate(drawn.loads(self.world, self.extent)):
            pose = self._load_pose(load)
            at = pose(self.placed)
            node = self.server.scene.add_frame(f"/loads/{index}", show_axes=False, position=at.position)
            made.append(Placed(node, pose))
            colour = TORQUE_COLOUR if load.turning else FORCE_COLOUR
            arrow = np.array([[(0.0, 0.0, 0.0), load.along]])
            made.append(Placed(self.server.scene.add_arrows(f"/loads/{index}/arrow", arrow, colour, **size)))
            made.append(Placed(self.server.scene.add_label(f"/loads/{index}/words", load.words, position=load.along)))
        return made

    def _load_pose(self, load: drawn.Load) -> Callable[[dict[str, Pose]], Pose]:
        def pose(placed: dict[str, Pose]) -> Pose:
            at = load.at if load.body is None else frames.compose(placed[load.body], Pose(load.at)).position
            return Pose(at)

        return pose

    def _names(self) -> list[Placed]:
        return [
            Placed(self.server.scene.add_label(f"/world/{_path(body.name)}/name", visible(body.name)))
            for body in drawn.named_bodies(self.world)
        ]

    # --- camera and controls --------------------------------------------------------------------------------------------

    def _look(self) -> None:
        camera, centre, radius = self.server.initial_camera, np.array(self.extent.centre), self.extent.radius
        target = centre + RIGHT_OF_SCENE * radius * np.array([0.73, 0.68, 0.0])
        camera.position = target + 1.9 * radius * np.array([0.62, -0.66, 0.42])
        camera.look_at = target

    def _controls(self) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        with gui.add_folder("Show"):
            for group in GROUPS:
                box = gui.add_checkbox(group, group in SHOWN_FIRST)
                box.on_update(lambda event, group=group: self.show(group, event.target.value))
        self._joint_controls()
        self._contact_controls()
        self._body_controls()
        for group in SHOWN_FIRST:
            self.show(group, True)

    def _joint_controls(self) -> None:
        gui, ranges = self.server.gui, slider_ranges(self.world, self.extent.radius)
        if not ranges:
            return
        with gui.add_folder("Joints"):
            for slider in ranges[:MOST_SLIDERS]:
                low, high, value = (round(number, DIGITS) for number in (slider.low, slider.high, slider.start))
                made = gui.add_slider(slider.label, low, max(high, low), SLIDER_STEP, value)
                made.on_update(lambda event, joint=slider.joint: self._slid(joint))
                self._sliders.append((slider, made))
            gui.add_button("Initial state").on_click(lambda event: self.reset())
            if (more := len(ranges) - MOST_SLIDERS) > 0:
                gui.add_text("More joints", f"{more} without a slider", disabled=True)

    def _slid(self, joint: Joint) -> None:
        values = [
            min(max(made.value, slider.low), slider.high) for slider, made in self._sliders if slider.joint is joint
        ]
        if len(values) == (3 if joint.kind == "ball" else 1):
            self.move({joint.name: joint_position(joint, values)})

    def reset(self) -> None:
        """Move everything to the initial state, the sliders too."""
        for slider, made in self._sliders:
            made.value = round(slider.start, DIGITS)
        self.move(initial_positions(self.world))

    def _contact_controls(self) -> None:
        laws, gui = drawn.law_lines(self.world), self.server.gui
        with gui.add_folder("Contact", expand_by_default=False, visible=bool(laws)):
            self._near = gui.add_text("Pairs", "not shown", disabled=True)
            for materials, words in laws[:MOST_LAWS]:
                gui.add_text(visible(materials), words, disabled=True)
            if len(laws) > MOST_LAWS:
                gui.add_text("More", f"{len(laws) - MOST_LAWS} pairs of materials", disabled=True)

    def _body_controls(self) -> None:
        bodies = drawn.named_bodies(self.world)[:MOST_CHOICES]
        gui = self.server.gui
        self._by_label = {visible(body.name): body for body in bodies}
        with gui.add_folder("Body", expand_by_default=False, visible=bool(bodies)):
            self._choice = gui.add_dropdown("Name", tuple(self._by_label) or ("",))
            self._choice.on_update(lambda event: self._show_body())
            self._numbers = {name: gui.add_text(name, "", disabled=True) for name in ("Mass", "Position", "Rotation")}
        self._show_body()

    def _show_body(self) -> None:
        """Write the numbers of the chosen body."""
        body = self._by_label.get(self._choice.value)
        if body is None:
            return
        pose = self.placed[body.name]
        self._numbers["Mass"].value = f"{body.inertial.mass:.6g} kg"
        self._numbers["Position"].value = f"{', '.join(f'{part:.4f}' for part in pose.position)} m"
        self._numbers["Rotation"].value = f"{', '.join(f'{part:.4f}' for part in pose.quaternion)} (w x y z)"


def _path(name: str) -> str:
    """A name as one part of the path of a node."""
    return visible(name).replace("/", "∕")
