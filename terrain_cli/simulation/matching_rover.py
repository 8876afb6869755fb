"""The rover.toml that fits a simulated log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.toml import toml_text

if TYPE_CHECKING:
    from terrain_cli.simulation.scenario import Scenario

JOINTS = "/joint_states"
#: A file that begins so may be replaced.
HEADER = "# Written by terrain-est simulate, which replaces it as long as this line stands first."


def identifier(wheel: str) -> str:
    """Return the name of a wheel as topics and joints have it: no hyphens."""
    return wheel.replace("-", "_")


def joint(wheel: str) -> str:
    """Return the name of a wheel's joint."""
    return f"{identifier(wheel)}_joint"


def text(scenario: Scenario) -> str:
    """Write what a reader of the log needs to know of the rover; nothing of its effects."""
    wheel = scenario.geometry
    lines = [
        HEADER,
        "# Tables name their columns as channels: the entries with a topic are for bags.",
        "",
        "[wheel]",
        f"radius = {toml_text.value(wheel.radius)}  # m",
        f"width = {toml_text.value(wheel.width)}  # m",
    ]
    if wheel.grouser_count:
        lines.append(f"grouser_count = {wheel.grouser_count}")
        lines.append(f"grouser_height = {toml_text.value(wheel.grouser_height)}  # m")
    shear_modulus = toml_text.value(scenario.soils[0].shear_modulus)
    lines += ["", "[soil]", f"shear_modulus = {shear_modulus}  # m, of {scenario.soils[0].name}"]
    for place in scenario.wheels:
        lines += ["", f"[wheels.{toml_text.key(place.name)}]"]
        if len(scenario.wheels) > 1:
            lines.append(f"position = {toml_text.value([place.x, place.y, 0.0])}  # m")
        entry = {"topic": JOINTS, "field": "effort", "name": joint(place.name), "unit": "N m"}
        lines += [
            f"[wheels.{toml_text.key(place.name)}.channels]",
            "# A JointState does not say whether its effort is a torque or a current.",
            f"torque = {toml_text.value(entry)}",
        ]
    return "\n".join(lines) + "\n"
