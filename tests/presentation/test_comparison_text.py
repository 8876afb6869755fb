"""A comparison in words."""

from types import SimpleNamespace

from terrain_cli.presentation import comparison_text


def test_a_channel_that_is_off_without_a_finding_is_told_why():
    def off(ratio):
        return SimpleNamespace(heldout_rmse=ratio, noise=1.0)

    finding = SimpleNamespace(channel="sinkage", share=0.96)
    channels = {"torque": off(6.5), "drawbar_pull": off(1.1), "sinkage": off(1.8)}
    compared = SimpleNamespace(channels=channels, failures=[finding])
    (line,) = comparison_text._off_too(compared)
    assert line == (
        "  torque is off too: the fitted soil spreads an error of one channel over the others. "
        "These findings explain 96% of the whole misfit"
    )
    assert list(comparison_text._off_too(SimpleNamespace(channels={}, failures=[finding]))) == []
    # What hardly explains anything has spread nothing.
    finding.share = 0.17
    (line,) = comparison_text._off_too(compared)
    told = "and no finding tells why: these explain only 17% of the whole misfit"
    assert line == f"  torque is off too, {told}"
