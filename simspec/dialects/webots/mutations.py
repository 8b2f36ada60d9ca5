"""Changes of a .wbt and its sidecar that move nothing, for the complete self-test; see ``dialects/kit/mutations.py``."""

from __future__ import annotations

from simspec.dialects.kit.mutations import Addition, Inert, MutationTable

_COLOUR = "colours move nothing"
_LABEL = "what the files are of: the engine's process, where there is one, is told by other means"
_NEXT = "the order of bodies, shapes or laws"
_SYMMETRIC = "what one number says of two bodies, in either order"

ADDITIONS = (
    Addition("settings", "true", "sleeping"),
    Addition("", "9.81", "strength"),
)

TABLE = MutationTable(
    integers=frozenset(("schema", "settings.contact_points")),
    additions={"sidecar.json": ADDITIONS},
    inert=(
        Inert("WorldInfo/title", "the name of the world", ("word",)),
        Inert("PBRAppearance/baseColor", _COLOUR),
        Inert("PBRAppearance/transparency", _COLOUR, ("scaled", "moved", "sign")),
        Inert("Solid/rotation", "half a turn, which is the same to both sides", ("sign",), place="*BallJoint*"),
        Inert("passive.around.boxes.*.box.edges.*", "a box has no sign", ("sign",), "sidecar.json"),
        Inert("engine", _LABEL, ("word",), "sidecar.json"),
        Inert("world", _LABEL, ("word",), "sidecar.json"),
        Inert("format", _LABEL, ("word",), "sidecar.json"),
        Inert("joints.*", "the name of a joint that does not move", ("word", "swapped"), "sidecar.json"),
        Inert("shapes.*.name", "the name of a shape", ("word",), "sidecar.json"),
        *(
            Inert(
                f"settings.{name}",
                "acts in contacts, whose numbers are compared with it",
                ("scaled", "sign"),
                "sidecar.json",
            )
            for name in ("softness", "contact_points")
        ),
        *(
            Inert(site, _NEXT, ("swapped",), "sidecar.json")
            for site in (
                "shapes.*",
                "velocity_limits.*",
                "effort_limits.*",
                "damping.*",
                "springs.*",
                "untold_limits.*",
                "starts.*",
            )
        ),
        *(
            Inert(site, _SYMMETRIC, ("swapped",), "sidecar.json")
            for site in ("passive.gravity_scales.*", "passive.around.boxes.*", "passive.free_damping.*")
        ),
    ),
)
