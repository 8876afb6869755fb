"""What single effects do, by values worked out elsewhere and by the signature that each is said to leave."""

from __future__ import annotations

import numpy as np
import pytest
from known_effects import KNOWN_EFFECTS, MOVED, SAME, UP

from terrain_cli import effects
from terrain_cli.effects.laws import effect_file
from terrain_cli.effects.library.law_functions import bearing_factors
from terrain_cli.mechanics.effect import KINDS
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import Model, predict
from terrain_cli.telemetry.derived_channels import slip as slip_of


@pytest.fixture(scope="module")
def steady():
    """Return one sample: on a slope, faster than the reference speed, speeding up, on a used track."""
    sample = {"load": 80.0, "slip": 0.3, "velocity": 0.2, "angular_velocity": 2.3, "pitch": 0.15}
    sample |= {"slip_angle": 0.2, "pass_number": 1.0, "motor_temperature": 60.0, "acceleration": 0.1}
    sample |= {
        "angular_velocity_rate": 0.4,
        "torque_rate": 0.5,
        "wheel_angle": 0.13,
        "rut_slope": 0.01,
        "drawbar_pull_rate": 0.1,
        "sinkage_rate": 0.001,
    }
    rising, one = np.arange(3.0), np.zeros(3, dtype=int)
    slopes_of = {"torque": 0.5, "drawbar_pull": 0.1, "sinkage": 0.001}
    shown = {name: slope * rising for name, slope in slopes_of.items()}
    past = along(rising, one, np.full(3, 0.2), shown)
    channels = {name: np.array([number]) for name, number in sample.items()}
    return channels | {name: column[1:2] for name, column in past.items()}


def under(wheel, soil, channels, name=None, values=None, **options):
    model = Model(effects=(effects.find(name),) if name else ())
    own = {f"{name}.{parameter}": number for parameter, number in (values or {}).items()}
    return predict(model, wheel, channels, soil | model.nulls() | own, **({"given": "load"} | options))


@pytest.mark.parametrize("name", effects.NAMES)
def test_leaves_its_signature(name, wheel, soil, steady):
    known = KNOWN_EFFECTS[name]
    bare, changed = under(wheel, soil, steady), under(wheel, soil, steady, name, known.shown or known.values)
    for output, how in zip(("sinkage", "torque", "drawbar_pull"), known.signature, strict=True):
        change = float(getattr(changed, output)[0] - getattr(bare, output)[0])
        size = abs(float(getattr(bare, output)[0]))
        if how == SAME:
            assert abs(change) <= 1e-10 * size, output
        else:
            assert abs(change) > 1e-5 * size, output
            assert how == MOVED or (change > 0.0) == (how == UP), output


@pytest.mark.parametrize(
    ("degrees", "n_c", "n_q", "n_gamma"),
    # Terzaghi's table for general shear.
    [(10, 9.60, 2.69, 1.2), (20, 17.69, 7.44, 4.9), (30, 37.16, 22.46, 19.7), (40, 95.66, 81.27, 100.4)],
)
def test_bearing_factors_are_terzaghis(degrees, n_c, n_q, n_gamma):
    found = bearing_factors(np.tan(np.radians(degrees)))
    np.testing.assert_allclose(found[:2], (n_c, n_q), rtol=2e-3)
    assert found[2] == pytest.approx(n_gamma, rel=0.25)


@pytest.mark.parametrize("error", [-0.1, 0.0, 0.07])
def test_wheel_radius_is_that_from_which_slip_is_computed(error):
    stated, omega = 0.125, 1.0
    velocity = np.linspace(0.02, 0.3, 30)
    law = effects.find("wheel-radius").laws["slip"]
    shown = slip_of(velocity, omega, radius=stated)
    felt = slip_of(velocity, omega, radius=stated * (1.0 + error))
    np.testing.assert_allclose(law({"slip": shown, "relative_error": error}), felt, atol=1e-12)


def test_softening_with_a_length_of_k_is_wongs_hump():
    """Wong 2008: τ = τp Kr (1 + (1/(Kr (1 − 1/e)) − 1) exp(1 − j/Kw)) (1 − exp(−j/Kw)), peak τp at j = Kw."""
    k, residual = 0.02, 0.66
    j = np.linspace(1e-4, 0.2, 50)
    hump = residual * (1.0 + (1.0 / (residual * (1.0 - 1.0 / np.e)) - 1.0) * np.exp(1.0 - j / k))
    start = np.e / (1.0 - 1.0 / np.e) - (np.e - 1.0) * residual
    law = effects.find("post-peak-softening").laws["shear_stress"]
    q = {"shear_stress": start, "shear_displacement": j, "length": k, "loss": 1.0 - residual / start}
    np.testing.assert_allclose(law(q), hump, rtol=1e-12)


def test_slip_sinkage_comes_near_lyasko(wheel, soil):
    """Sinkage under one load rises with slip as z0 (1 + S i)/(1 − 0.5 S i) does, within a few percent."""
    slip = np.linspace(0.0, 0.6, 7)
    channels = {"load": np.full(7, 60.0), "slip": slip}
    still = under(wheel, soil, channels).sinkage
    sinkage = under(wheel, soil, channels, "slip-sinkage", {"n1": 0.4}).sinkage / still
    size = np.linspace(0.2, 1.2, 400)[:, None]
    misfit = np.max(np.abs((1.0 + size * slip) / (1.0 - 0.5 * size * slip) / sinkage - 1.0), axis=1)
    assert np.min(misfit) < 0.05


def test_first_pass_makes_the_whole_gain_and_later_ones_little():
    law = effects.find("multi-pass").laws["stiffness"]
    driven = {"stiffness": 1.0, "stiffness_gain": 0.5, "pass_number": np.arange(5.0)}
    factor = law(driven | {"further": 0.0})
    np.testing.assert_allclose(factor[:2], [1.0, 1.5])
    assert np.all(np.diff(factor) > 0.0)
    assert factor[-1] < 1.8
    # Of each pass half of what the one before it did.
    half = law(driven | {"further": 0.5 - np.exp(-1.0)})
    np.testing.assert_allclose(half, [1.0, 1.5, 1.75, 1.875, 1.9375])


@pytest.mark.parametrize(
    ("dry", "slope", "drives"),
    [
        (0.99, -1.96, True),
        (0.99, -0.6, False),
        (0.99, 0.07, False),
        (-0.3, 0.2, True),
        # Of a power of the speed the straight line begins below 0, where the wheel never turns.
        (-0.15, 1.0, False),
    ],
)
def test_friction_may_fall_with_speed_but_never_drives(dry, slope, drives):
    """As it does where the parts hardly move (Stribeck); from 0.2 to 1.5 rad/s it brakes, or drives."""
    found = {"drivetrain-friction.Tc": dry, "drivetrain-friction.Bv": slope}
    speeds = {"angular_velocity": np.array([0.2, -1.5, np.nan])}
    wheel = found, np.diag([0.03, 0.03]) ** 2, speeds
    doubted = list(effects.find("drivetrain-friction").imitations([wheel]))
    assert bool(doubted) == drives
    both = ("drivetrain-friction.Tc", "drivetrain-friction.Bv")
    assert all(names == both for _, names, *_ in doubted)
    # Where no speed is measured, only the dry part is sought.
    alone = {"drivetrain-friction.Tc": dry}, np.diag([0.03]) ** 2, {}
    assert any(effects.find("drivetrain-friction").imitations([alone])) == (dry < -0.09)


def test_little_on_the_wrong_side_means_nothing_where_another_wheel_has_much():
    """The share of a wheel without the effect is noise that lasts, which standard errors take for white."""
    speeds, exact = {"angular_velocity": np.array([0.4, 1.0])}, np.diag([0.01, 0.01]) ** 2
    sizes = {"front": (0.04, -0.08), "rear": (0.97, -0.19)}
    front, rear = (
        ({"drivetrain-friction.Tc": dry, "drivetrain-friction.Bv": slope}, exact, speeds)
        for dry, slope in sizes.values()
    )
    friction = effects.find("drivetrain-friction")
    assert any(friction.imitations([front], errors=2.0, least=0.125))
    assert not any(friction.imitations([front, rear], errors=2.0, least=0.125))
    assert any(friction.imitations([front, rear], errors=2.0))


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("drivetrain-friction.Tc", 100.0 * 4.0),
        ("drivetrain-friction.Bv", 100.0 * 4.0),
        ("load-bias.offset", 100.0),
        ("load-bias.gain", 1.0),
        ("drawbar-bias.offset", 100.0),
        ("acceleration-torque.J", 100.0 * 4.0**2),
        ("sinkage-bias.offset", 4.0),
        ("gear-efficiency.eta", 1.0),
        ("crust.strength", 1.0),
    ],
)
def test_forces_are_as_large_as_the_wheel(name, times):
    effect = effects.find(name.partition(".")[0])
    (own,) = (one for one in effect.parameters if effect.qualified(one) == name)
    heavy = own.under(9810.0, 0.4)
    for before, after in ((own.scale, heavy.scale), (own.lower, heavy.lower), (own.upper, heavy.upper)):
        null = 0.0 if before == own.scale else own.null
        assert after - null == pytest.approx(times * (before - null))
    assert heavy.null == own.null
    assert own.under(98.1, 0.1) == own.under(3.0, 0.03) == own


@pytest.mark.parametrize(
    ("changes", "follows", "unit", "times"),
    [
        ("drawbar_pull", "yaw_rate", "N s/rad", 100.0),
        ("drawbar_pull", "velocity", "kN/(m/s)", 100.0),
        ("torque", "pitch", "N m", 400.0),
        ("cohesion", "pitch", "kPa", 1.0),
        ("sinkage", "pitch", "m", 1.0),
    ],
)
def test_bounds_that_a_user_says_hold_under_every_wheel(changes, follows, unit, times):
    told = f'id = "own"\ntitle = "own"\nchanges = "{changes}"\nlaw = "{changes} + a * {follows}"\n'
    sizes = "null = 0.0\nscale = 2.0\nlower = -5.0\nupper = 9.0\n"
    needs = f'needs = ["{follows}"]\n[parameters.a]\nunit = "{unit}"\n'
    (own,) = effect_file.parse(told + needs + sizes).parameters
    heavy = own.under(9810.0, 0.4)
    assert heavy.scale == pytest.approx(times * own.scale)
    assert (heavy.lower, heavy.upper) == (own.lower, own.upper)


def test_how_far_to_the_wrong_side_a_value_may_be_noise_grows_with_the_wheel():
    """An inertia of −12 kg m² ± 6 is at the end of what a search allows under a light wheel."""
    wheel = {"acceleration-torque.J": -12.0}, np.array([[6.0**2]]), {}
    inertia = effects.find("acceleration-torque")
    assert any(inertia.imitations([(*wheel, (98.1, 0.1))]))
    assert not any(inertia.imitations([(*wheel, (9000.0, 0.45))]))


def gives(name, quantity, wanted, **q):
    return name, quantity, q, wanted


def on_two_axles(moved, **measured):
    """Return the load of a wheel of 98 N behind or before what is measured, by which it moves."""
    q = {"load": 98.0665, "gravity": 9.80665, "ratio": 0.25, "slope_ratio": 0.0, **measured}
    return gives("load-transfer", "load", 98.0665 + 0.25 * moved, **q)


DEPTH, STRESS, PITCH = np.array([0.0, 0.01, 0.04]), np.array([2.5e3, 10e3, 40e3]), np.array([-0.3, 0.0, 0.25])
ALONG = 98.0665 * np.sin(0.1)
FRICTION = ("drivetrain-friction", "torque")


@pytest.mark.parametrize(
    ("name", "quantity", "q", "wanted"),
    [
        # Torque is counted positive the way the wheel turns: what a drivetrain takes is the same both ways.
        gives(*FRICTION, 2.7, torque=2.0, angular_velocity=1.5, Tc=0.4, Bv=0.2),
        gives(*FRICTION, 2.7, torque=2.0, angular_velocity=-1.5, Tc=0.4, Bv=0.2),
        gives(*FRICTION, 2.4, torque=2.0, Tc=0.4, Bv=0.2),
        *(
            gives("acceleration-torque", "torque", 2.3, torque=2.0, **turning, J=0.5)
            for way in (1.0, -1.0)
            for turning in [{"angular_velocity": way * 1.5, "angular_velocity_rate": way * 0.6}]
        ),
        gives("gear-efficiency", "torque", [2.5, -1.6], torque=np.array([2.0, -2.0]), eta=0.8),
        gives("slope", "load", 9.0 * np.cos(PITCH), load=9.0, pitch=PITCH, factor=1.0),
        gives(
            *("slope", "drawbar_pull", -9.0 * np.sin(PITCH)),
            load=9.0 * np.cos(PITCH),
            pitch=PITCH,
            factor=1.0,
            drawbar_pull=0.0,
        ),
        on_two_axles(12.0, measured_drawbar_pull=12.0),
        on_two_axles(ALONG, pitch=0.1),
        on_two_axles(3.0, acceleration=0.3),
        # A pull that is measured is not counted twice.
        on_two_axles(15.0, measured_drawbar_pull=12.0, pitch=0.1, acceleration=0.3),
        # The weight along the slope has a lever of its own, where a pull is measured.
        on_two_axles(12.0 + 2.0 * ALONG, measured_drawbar_pull=12.0, pitch=0.1, slope_ratio=0.5),
        on_two_axles(ALONG, pitch=0.1, slope_ratio=0.5),
        # A crust bears its strength, a firm layer begins at its top, an envelope turns about its reference.
        gives(
            *("crust", "normal_stress", 1.0 - np.exp(-DEPTH / 0.002)),
            normal_stress=0.0,
            depth=DEPTH,
            strength=1.0,
            thickness=0.002,
        ),
        gives(
            "hardpan",
            "normal_stress",
            [0.0, 0.0, 0.03],
            normal_stress=0.0,
            depth=DEPTH,
            modulus=1.0,
            top=0.01,
        ),
        gives(
            *("strength-curvature", "shear_stress", 500.0 + 0.6 * STRESS * (STRESS / 10e3) ** -0.1),
            normal_stress=STRESS,
            shear_stress=500.0 + 0.6 * STRESS,
            tan_phi=0.6,
            B=0.1,
            shear_displacement=1.0,
            shear_modulus=0.01,
        ),
    ],
)
def test_laws_give_what_is_worked_out_by_hand(name, quantity, q, wanted):
    np.testing.assert_allclose(effects.find(name).laws[quantity](q), wanted, rtol=1e-12, atol=1e-12)


def test_ripple_passes_once_a_grouser(wheel, soil):
    turn = np.linspace(0.0, 2.0 * np.pi, 12 * 16 + 1)
    channels = {"load": np.full(len(turn), 60.0), "slip": np.full(len(turn), 0.3), "wheel_angle": turn}
    bare = under(wheel, soil, channels)
    rippled = under(wheel, soil, channels, "grouser-ripple", {"pull_sine": 0.03, "pull_cosine": 0.04})
    wave = rippled.drawbar_pull - bare.drawbar_pull
    assert np.max(wave) == pytest.approx(60.0 * 0.05, rel=0.02)
    spectrum = np.abs(np.fft.rfft(wave[:-1]))
    assert np.argmax(spectrum) == wheel.grouser_count


def test_sideways_sliding_costs_nothing_straight_ahead(wheel, soil, steady):
    ahead = steady | {"slip_angle": np.zeros(1)}
    bare, same = (
        under(wheel, soil, ahead),
        under(wheel, soil, ahead, "side-slip", {"k_growth": 1.2, "lateral": 4.0}),
    )
    np.testing.assert_allclose(same.drawbar_pull, bare.drawbar_pull, rtol=1e-10)
    left, right = (
        under(wheel, soil, steady | {"slip_angle": np.array([angle])}, "side-slip", {"lateral": 4.0})
        for angle in (0.2, -0.2)
    )
    np.testing.assert_allclose(left.torque, right.torque, rtol=1e-12)


@pytest.mark.parametrize("top", [0.003, 0.012, 0.03])
def test_forces_over_a_layer_do_not_depend_on_the_nodes(wheel, soil, top):
    """Gauss nodes across the bend gave a load that was wrong by 3%, and by 9% with few of them."""
    channels = {"slip": np.full(20, 0.2), "sinkage": np.linspace(0.003, 0.04, 20)}
    hidden = {"modulus": 2e7, "top": top}
    few, many = (
        under(wheel, soil, channels, "hardpan", hidden, given="sinkage", order=order) for order in (6, 200)
    )
    for name in ("load", "torque", "drawbar_pull"):
        right = getattr(many, name)
        np.testing.assert_allclose(getattr(few, name), right, atol=1e-4 * np.abs(right).max())


def test_flexible_wheel_stands_on_the_contact_of_a_deeper_one():
    """Half the contact's length is √(2 r (z + δ)), but for what keeps it finite at no sinkage."""
    r, z, share = 0.15, 0.05, 0.06
    radius = effects.find("flexible-wheel").laws["radius"](
        {"radius": r, "wheel_radius": r, "sinkage": z, "deflection": share}
    )
    assert np.sqrt(2.0 * radius * z) == pytest.approx(np.sqrt(2.0 * r * (z + share * r)), rel=0.01)


@pytest.mark.parametrize("quantity", ["torque", "load"])
def test_effects_act_from_the_ground_to_the_sensor_however_they_are_listed(quantity):
    every = tuple(effects.catalogue().values())
    order = [[e.kind for e in Model(effects=listed).changing[quantity]] for listed in (every, every[::-1])]
    assert order[0] == order[1]
    assert order[0] == sorted(order[0], key=KINDS.index, reverse=quantity == "load")
    assert len(set(order[0])) > 1


@pytest.mark.parametrize("slip", [0.3, -0.02, -0.3])
def test_grousers_with_the_slip_of_their_tips_are_a_gear(wheel, soil, slip):
    """With j = rs [θ1 − θ − (1 − i)(sin θ1 − sin θ)] all is as on the rim of a stronger soil, but T rs/r."""
    _, ding = effects.find("grousers").forms
    channels = {"load": np.array([60.0, 90.0]), "slip": np.full(2, slip)}
    gain = 1.0 + 0.6 * wheel.grouser_height / wheel.radius
    found = predict(Model(effects=(ding,)), wheel, channels, {**soil, "grousers.lambda_s": 0.6}, given="load")
    stronger = {name: soil[name] * gain for name in ("cohesion", "tan_phi")}
    stronger["shear_modulus"] = soil["shear_modulus"] / gain
    bare = predict(Model(), wheel, channels, {**soil, **stronger}, given="load")
    np.testing.assert_allclose(found.sinkage, bare.sinkage, rtol=1e-9)
    np.testing.assert_allclose(found.drawbar_pull, bare.drawbar_pull, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found.torque, gain * bare.torque, rtol=1e-8)
    nothing = {**soil, "grousers.lambda_s": 0.0}
    absent, bare = (
        predict(Model(effects=own), wheel, channels, nothing, given="load") for own in ((ding,), ())
    )
    np.testing.assert_allclose(absent.torque, bare.torque, rtol=1e-12)
