"""What a person is told where nothing is found."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from terrain_cli.comparison import finding_sentences
from terrain_cli.comparison.comparison_outcome import ChannelErrors, Comparison

GROSS = ChannelErrors(
    name="drawbar_pull",
    unit="N",
    n=900,
    rmse=11.0,
    bias=0.1,
    nrmse=0.6,
    noise=0.6,
    heldout_rmse=12.0,
    heldout_low=9.0,
    heldout_high=14.0,
)
FINE = ChannelErrors(
    name="torque",
    unit="N m",
    n=900,
    rmse=0.4,
    bias=0.0,
    nrmse=0.1,
    noise=0.4,
    heldout_rmse=0.41,
    heldout_low=0.38,
    heldout_high=0.45,
)


def compared(blocks=8, **channels):
    """Return what is read of a comparison: its channels, and the stretches of its data."""
    return Comparison(
        model={},
        wheels=[SimpleNamespace(blocks=np.arange(blocks))],
        channels=channels,
        failures=[],
        warnings=[],
    )


def test_an_error_beyond_noise_is_told():
    told = finding_sentences.beyond_noise(compared(torque=FINE, drawbar_pull=GROSS))
    assert (
        told == "the held-out error is 20 times the noise of drawbar pull, yet no recorded channel tracks it"
    )
    both = finding_sentences.beyond_noise(
        compared(torque=replace(FINE, heldout_rmse=0.7), drawbar_pull=GROSS), 1.5
    )
    assert both.startswith("the held-out error is 1.7 times the noise of torque and 20 times the noise of")


def test_few_blocks_do_not_tell_what_an_error_follows():
    told = finding_sentences.beyond_noise(compared(6, sinkage=GROSS))
    assert told.endswith("noise of sinkage, yet 6 independent stretches of data are too few to show why")


def test_an_error_that_is_noise_is_not():
    assert finding_sentences.beyond_noise(compared(torque=FINE)) == ""
    assert (
        finding_sentences.beyond_noise(compared(torque=replace(FINE, noise=np.nan, heldout_rmse=9.0))) == ""
    )
