"""The measures of the validation find what is known, and the document tells what they find."""

import numpy as np
import pytest

pytest.importorskip("phri_sim", reason="the workspace is not built")
from studies import _bench, _docs, _page, validation  # noqa: E402


def minimum_jerk_speed(t, distance, duration):
    s = np.clip(t / duration, 0, 1)
    return distance * 30 * s**2 * (1 - s) ** 2 / duration


def test_a_minimum_jerk_speed_is_one_and_a_constant_one_is_not():
    t = np.arange(0, 2, 0.001)
    for distance, duration in ((0.1, 0.8), (0.3, 1.7)):
        assert validation.minimum_jerk_r2(t, minimum_jerk_speed(t, distance, duration), distance) > 0.9999
    constant = np.where((t > 0.2) & (t < 1.2), 0.1, 0.0)
    assert validation.minimum_jerk_r2(t, constant, 0.1) < 0.9


@pytest.mark.parametrize("ratio", [1.5, 3.0])
def test_harmonic_motion_on_an_ellipse_has_the_exponent_one_third(ratio):
    # Viviani and Cenzato 1985: it obeys the two-thirds power law exactly.
    phase = np.arange(0, 4 * np.pi, 0.02)
    x, y = 0.08 * np.cos(phase), 0.08 / ratio * np.sin(phase)
    assert validation._exponent(x, y, 0.01) == pytest.approx(1 / 3, abs=0.01)


def test_constant_speed_has_the_exponent_zero():
    length = np.linspace(0, 3, 3000)
    angle = np.cumsum(10.0 + 8.0 * np.sin(9.0 * length)) * (length[1] - length[0])
    x, y = np.cumsum(np.cos(angle)) * 1e-3, np.cumsum(np.sin(angle)) * 1e-3
    assert validation._exponent(x, y, 0.01) == pytest.approx(0.0, abs=0.02)


def test_what_was_not_found_is_missed():
    assert not validation.row("a", "b", 0.95, None, np.nan)["met"]
    assert not validation.row("a", "b", None, 0.05, 0.06)["met"]
    assert validation.row("a", "b", None, 0.05, 0.05)["met"]


def test_the_wave_is_a_channel_of_its_width():
    picture = _bench.wave_room(0.05, 0.045, 0.13)
    free = (picture == 255).sum(axis=0) * _bench.RESOLUTION
    assert free.min() >= 0.05 - 2 * _bench.RESOLUTION, "a vertical cut is never narrower than the channel"
    assert (picture[:10] == 0).all() and (picture[-10:] == 0).all()


def test_a_push_moves_the_object_alone_and_the_reflex_follows_its_delay():
    # The acceleration is that of the object alone; the reflex comes at the delay asked for, whichever it is.
    for mass in (5.0, 50.0):
        ratio = validation.step(mass, 0.0)["found"]
        assert ratio == pytest.approx((mass + 1.3) / mass, rel=0.01)
    for delay in (0.05, 0.07, 0.09):
        entry = validation.reflex(delay)
        assert entry["met"], entry


def test_the_document_tells_the_validation_as_it_is():
    found = validation.table(validation.PEOPLE)
    document = _docs.DOCUMENT.read_text(encoding="utf-8")
    assert _docs.block(document, "validation") == _page.markdown(*validation.rows_of_text(found))
    assert 0 < found["met"].sum() < len(found), "a model of people meets some and misses some"
