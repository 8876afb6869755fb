"""Files of effects as users write them."""

from __future__ import annotations

CABLE = """id = "cable-drag"
title = "Umbilical drags on the carriage"
changes = "drawbar_pull"           # a channel, or an inner quantity
law = "drawbar_pull - cd * abs(yaw_rate)"
needs = ["yaw_rate"]
[parameters.cd]
unit = "N s/rad"
null = 0.0
scale = 10.0
lower = 0.0
reference = "own measurement"
"""


def effect(changes, law, unit="1", needs=(), null=0.0, more="", columns=""):
    listed = ", ".join(f'"{need}"' for need in needs)
    return f"""id = "own"
title = "Own"
changes = "{changes}"
law = '''{law}'''
needs = [{listed}]
{columns}
[parameters.a]
unit = "{unit}"
null = {null}
scale = 1.0
{more}"""
