"""What every verb says at its end: whether the model fits to within the noise, and else what to do."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

from terrain_cli.comparison import comparison_criteria
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import above_noise, too_few
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.effects import NAMES
from terrain_cli.models import ASSUMPTIONS
from terrain_cli.vocabulary.next_commands import Asked
from terrain_cli.vocabulary.quantities import counted, listed

State = Literal["fits", "explained", "unexplained", "undecided"]
_MOST_NAMED = 4  # Channels to be recorded, and places, that a sentence names
#: What tells the soil from an effect: soil stays in its place, and neither slopes nor heat nor wear do.
_BACK = "drive beside this track in the opposite direction"


@dataclass(frozen=True)
class Conclusion:
    """What is said at the end."""

    state: State
    sentence: str  # With the command
    command: str = ""  # The next one, ready to paste
    record: tuple[str, ...] = ()  # Channels that are worth recording
    drive: str = ""  # The drive to take before that command

    @property
    def lead(self) -> str:
        """The sentence without the command."""
        return self.sentence.rpartition(" Next")[0] if self.command else self.sentence


def conclude(found: Evidence, asked: Asked) -> Conclusion:
    """Return the conclusion of some evidence; the same for the same, whichever verb collected it."""
    told = _concluded(found, asked)
    if not told.command or not asked.piped:
        return told
    # Pasted alone, such a command would wait for somebody to type the data.
    again = f"{told.lead} Next, with the same data on standard input: {told.command}"
    return replace(told, sentence=again)


def _concluded(found: Evidence, asked: Asked) -> Conclusion:
    known = {name: ratio for name, ratio in found.ratios.items() if math.isfinite(ratio)}
    above = found.above
    few = found.blocks < criteria.BLOCKS_OF_ALARM
    limited = _at_limit(found, asked)
    doubtful = limited or (_doubtful(found, asked) if above or found.raised else None)
    if doubtful or (found.raised and not few and not _refused(found) and not found.vain):
        elsewhere = doubtful or _in_a_stretch(found, asked)
        cause, command = elsewhere or _next(found, asked)
        if (limited or found.verdict is None) and known and not above:
            # Nothing is proved where the errors are those of noise: a first check alone, or a sensor's limit.
            told = f"The model may miss something: {_at_most(known)}, but {cause}. Next: {command}"
            return Conclusion("explained", told, command)
        size = f"with {counted(found.fewer, 'soil')} instead of {found.soils}, " * bool(found.fewer)
        size += _size(above) if above else _not_random(known)
        size += f" (noise of {found.noise_with})" * bool(found.noise_with)
        alike = found.verdict == "family" and not found.together and not elsewhere
        drive, first = (found.drive, _first(found)) if alike else ("", "")
        if found.fewer and found.changes:
            too = "better" if found.better else "too"
            soil = f"A soil that changes at {_places(found)} would explain it {too}"
            first = f" {soil}. To tell, {_settled(found)}.{first}"
            drive = drive or _BACK * (not found.points)
        verb = "may miss" if known and not above and not doubtful else "misses"
        told = f"The model {verb} something: {size}, and {cause}.{first} Next: {command}"
        return Conclusion("explained", told, command, drive=drive)
    if found.small and not few:
        told = f"The model fits well enough: {found.small}, less than --smallest-share asks for."
        return Conclusion("fits", told)
    if few or (not known and not found.raised):
        return _undecided(found, above, asked, few=few)
    # What a loop left unexplained is no less so where a comparison, which looks at less, finds nothing.
    left = found.ended and found.verdict is None and not (found.impossible or found.beyond)
    if above or found.raised or found.tracked or left:
        return _unexplained(found, above, known, asked)
    return _fits(found, known, asked)


def _fits(found: Evidence, known: Mapping[str, float], asked: Asked) -> Conclusion:
    soils = f"with {counted(found.soils, 'soil')}{f' under {found.wheels} wheels' * (found.wheels > 1)}"
    if found.instead and found.instead not in found.refused and not found.ended:
        command = asked.looked("diagnose")
        told = f"The model may miss something: {_at_most(known)}, but only {soils}; with {found.instead}"
        return Conclusion("explained", f"{told}, fewer may be enough. Next: {command}", command)
    told = f"The model fits to within the noise{f' {soils}' * bool(found.changes)}: {_at_most(known)}"
    told += ", as is to be expected by chance with so few points" * bool(above_noise(known))
    if found.impossible:
        told += f", but only with {listed(found.impossible)}, which is physically impossible: the soil "
        told += "imitates something that is missing, or a sensor is wrong."
        if found.verdict is None and not found.refused and not found.ended:
            command = asked.looked("diagnose")
            return Conclusion("unexplained", f"{told} Next: {command}", command)
        check = "Check zero and gain of each sensor, and drive over a wider range of load and slip."
        return Conclusion("unexplained", f"{told} {check}")
    if found.beyond:
        imitate = "imitate" if len(found.beyond) > 1 else "imitates"
        command = asked.removed([*found.beyond])
        told += f", but only with {listed([*found.beyond.values()])}: {listed([*found.beyond])} {imitate} "
        told += f"something else. To see what is missing, remove it. Next: {command}"
        return Conclusion("unexplained", told, command)
    if found.weak:
        told += f". The residuals look like {found.weak}, but so small an effect lowers no held-out error: "
        told += "the noise of load, slip and sinkage hides it. To decide, measure these with less noise."
    elif found.blocks < comparison_criteria.FEWEST_BLOCKS:
        told += f". No effect shows, but {too_few(found.blocks)} to rule one out. {_more(found)}"
    else:
        told += ", and the data show no missing effect."
    if found.changes:
        needed = ", and no effect predicts as well with fewer soils" * found.needed
        told += f" The soil changes at {_places(found)}{needed}."
    if found.like_a_soil:
        like = listed(found.like_a_soil, "or")
        told += f" Without drawbar pull, {like} would look much like another soil."
    if found.absent:
        command = asked.removed(found.absent)
        what = listed(found.absent)
        told += f" It fits as well without {what}, which does nothing at its fitted size. Next: {command}"
        return Conclusion("fits", told, command)
    return Conclusion("fits", told)


def _places(found: Evidence) -> str:
    few = len(found.changes) <= _MOST_NAMED
    return listed(list(found.changes)) if few else f"{len(found.changes)} places"


def _settled(found: Evidence) -> str:
    """Say what tells a soil that changes from an effect."""
    again = "repeat the test points in another order" if found.points else _BACK
    return f"{again}: if the misfit changes at the same place, the soil is the cause"


def _first(found: Evidence) -> str:
    """Say what to do before an effect is added that others look like."""
    if not found.drive and not found.checks:
        return ""
    check = listed(list(found.checks), "or") if found.checks else ""
    tell = "tell all of them apart" if len(found.family) > 1 else "rule out all others"
    told = f" No drive can {tell}. First {check}."
    if found.drive:
        told = f" First record this drive, and diagnose both logs together: {found.drive}."
        told += f" Also {check}: the drive alone does not {tell}." * bool(check)
    return f"{told} Without that, the next command chooses by the held-out error alone."


def _refused(found: Evidence) -> bool:
    """Tell whether everything that was named, if a diagnosis named any, was tried and did not pay."""
    named = found.together or found.family
    if found.verdict is None:
        return bool(found.refused) or found.ended
    if found.verdict == "unknown":
        # A law was drafted anew.
        return bool({*found.refused} - {*NAMES, *ASSUMPTIONS})
    return bool(named) and {*named} <= {*found.refused}


def _unexplained(
    found: Evidence, above: Mapping[str, float], known: Mapping[str, float], asked: Asked
) -> Conclusion:
    size = _size(above) if above else _not_random(known)
    few = found.blocks < comparison_criteria.FEWEST_BLOCKS
    command, elsewhere = "", _in_a_stretch(found, asked)
    # Who has diagnosed it, now or in the loop that ended, knows that nothing is left to try.
    diagnosed = found.verdict is not None or found.ended
    tried = found.refused and (_refused(found) or found.verdict == "none")
    if diagnosed and (_refused(found) or not found.raised) and known and not above:
        why = _did_not_pay(found) if tried else "no effect explains it"
        told = (
            f"The model fits as well as these data can tell: {_at_most(known)}. The residuals may be "
            f"systematic, but {why}."
        )
        return Conclusion("unexplained", told, record=found.unrecorded)
    if not diagnosed and not found.refused:
        # Scores are no diagnosis, which also tries other soils and laws of its own.
        why, command = "a first check of the effects finds no cause", asked.looked("diagnose")
    elif found.closest and found.closest not in found.refused and not _refused(found):
        why = f"no effect explains it significantly; held-out data can test {found.closest}"
        command = asked.added((found.closest,))
    elif tried:
        why = _did_not_pay(found)
        # A diagnosis would propose the same again; where it drafted a law, no effect explains it.
        named = {*found.refused} & {*NAMES, *ASSUMPTIONS}
        command = asked.added(["--until-quiet"]) if named and not diagnosed else ""
        if found.unconfirmed:
            # The drive that named it would again; what is in both, both name.
            command = asked.joined.looked("diagnose")
    elif elsewhere and not few:
        why, command = f"it misses {elsewhere[0]}", elsewhere[1]
    else:
        why = "no recorded channel tracks the misfit significantly"
        if found.tracked:
            why = "the residuals are systematic, but no effect explains them significantly"
        why = f"{too_few(found.blocks)} to show why" if few else why
    then = f"Next: {command}" if command else _record(found, few=few)
    drive = found.drive if _refused(found) and not command else ""
    if drive:
        # Where the soil imitates an effect, its error hardly falls though it is there.
        what = listed(found.refused, "or")
        then = f"To test {what} again, record this drive, and diagnose both logs together: {drive}."
    # That something is missing is not known: a soil that varies leaves as much.
    what = "does not fit to within the noise" if above else "may miss something"
    told = f"The model {what}: {size}; {why}. {then}"
    return Conclusion("unexplained", told, command, found.unrecorded, drive)


def _undecided(found: Evidence, above: Mapping[str, float], asked: Asked, *, few: bool) -> Conclusion:
    if few:
        told = f"{too_few(found.blocks)} to tell whether the model misses something."
        told += f" {_size(above)[0].upper()}{_size(above)[1:]}." if above else ""
        return Conclusion("undecided", f"{told} {_more(found)}")
    of = listed(list(found.ratios) or ["the sensors"])
    told = f"The data show no missing effect, but the noise of {of} is not known: repeat some test points."
    # A diagnosis of test points also looks at their order.
    first = found.verdict is None and not found.refused and found.points
    command = asked.looked("diagnose") if first else ""
    return Conclusion("undecided", f"{told} Next: {command}" if first else told, command)


def _more(found: Evidence) -> str:
    if found.unsorted:
        return "The rows are not in the order of time: sort them by it."
    if found.points:
        return "Measure more test points."
    times = math.ceil(comparison_criteria.FEWEST_BLOCKS / max(found.blocks, 1))
    return f"Record a drive at least {times} times as long."


def _size(above: Mapping[str, float]) -> str:
    (first, ratio), *others = above.items()
    told = [f"{_number(ratio)} × the noise in {first}", *(f"{_number(one)} × in {n}" for n, one in others)]
    return f"the held-out error is {listed(told)}"


def _number(ratio: float) -> str:
    return f"{ratio:.1f}" if ratio < 9.95 else f"{ratio:.0f}"


def _at_most(known: Mapping[str, float]) -> str:
    if not known:
        return "the noise of the sensors is not known"
    most = max(known, key=lambda name: known[name])
    return f"the held-out error is at most {known[most]:.2f} × the noise (in {most})"


def _not_random(known: Mapping[str, float]) -> str:
    """Say that errors which are as small as the noise follow something."""
    return f"{_at_most(known)}{', but the residuals are systematic' * bool(known)}"


def _next(found: Evidence, asked: Asked) -> tuple[str, str]:
    """Say what explains the misfit, and return the command that follows from it."""
    if found.verdict == "unknown":
        cause = f"no effect of the catalogue explains it{f': {found.law}' if found.law else ''}"
        return cause, asked.added([found.draft]) if found.draft else asked.looked(
            "diagnose", "--draft", asked.law
        )
    if found.together:
        cause = f"{listed(found.together)} together explain it best"
        if found.together_or:
            pairs = [" with ".join(pair) for pair in (found.together, *found.together_or)]
            cause = f"{listed(pairs, 'or')} explains it; these data cannot tell which"
        return cause, asked.added(found.together)
    part = "most of it" if found.leaves or found.share < 1.0 - criteria.DRAFT_LEFT else "it"
    part = "a part of it" if found.share < criteria.STEPS_SHARE else part
    if found.verdict == "effect":
        return f"{found.family[0]} explains {part}", asked.added(found.family[:1])
    if len(found.family) > 1:
        cause = f"one of {listed(found.family)} explains {part}; these data cannot tell which"
        return cause, asked.added(["--until-quiet"])
    if found.family:
        cause = f"{found.family[0]} explains {part}, but this is not certain"
        return cause, asked.added(found.family)
    checked = "a first check of the effects finds a possible cause"
    return "the residuals are systematic" if found.tracked else checked, asked.looked("diagnose")


def _doubtful(found: Evidence, asked: Asked) -> tuple[str, str] | None:
    """Send to rover.toml where a sign or a unit is doubted: what an effect explains of it is no physics."""
    if not found.doubted:
        return None
    settle = "if so, copy the line of the note into rover.toml; if not, copy it with the right unit or sign"
    return f"{listed(found.doubted)} may be wrong: {settle}", asked.looked("compare")


def _at_limit(found: Evidence, asked: Asked) -> tuple[str, str] | None:
    """Leave out the samples in which a sensor is stuck or at its limit: what they miss may pass for noise."""
    if not found.at_limit:
        return None
    channels = listed([one.split()[0].replace("_", " ") for one in found.at_limit])
    kept = asked
    for condition in found.at_limit:
        kept = kept.where(condition)
    cause = f"the sensor of {channels} may be stuck, or at its limit: leave these samples out"
    return cause, kept.looked("compare")


def _in_a_stretch(found: Evidence, asked: Asked) -> tuple[str, str] | None:
    """Say when the model misses, and return the command that leaves that out, if no effect explains most."""
    if found.stretch is None or found.share > criteria.STEPS_SHARE:
        return None
    low, high = (f"{time:.12g}" for time in found.stretch)
    when, others = f"from {low} s to {high} s", f"time < {low} or time > {high}"
    if math.isinf(found.stretch[1]):
        # What begins at some time and stays may be an effect: only a diagnosis tells that it is none.
        if found.verdict is None and not found.ended:
            return None
        when, others = f"after {low} s", f"time < {low}"
    cause = f"most of all {when}: find out what happened then, and whether the model fits the rest"
    return cause, asked.where(others).looked("compare")


def _did_not_pay(found: Evidence) -> str:
    were, them = ("was", "it") if len(found.refused) == 1 else ("were", "them")
    who = "another drive does not confirm" if found.unconfirmed else "held-out data do not support"
    return f"{listed(found.refused)} {were} tried, and {who} {them}"


def _record(found: Evidence, *, few: bool) -> str:
    if few:
        return _more(found)
    # On the same track the soil would vary as it did.
    again = "Repeat the test points on fresh soil" if found.points else "Repeat the drive beside this track"
    told = (
        f"{again}: if the misfit changes, the soil varies; if it stays the same, the model lacks something."
    )
    if found.fit_beside_pull:
        told = f"{listed(found.fit_beside_pull).capitalize()} fit, so look for something that acts on the "
        told += "drawbar pull alone: a slope, a tether or its sensor."
    if not found.unrecorded:
        return told
    more = [name.replace("_", " ") for name in found.unrecorded[:_MOST_NAMED]]
    such = ", such as" if len(found.unrecorded) > len(more) else ":"
    return f"{told} Also record a channel that effects need{such} {listed(more, 'or')}."
