"""The dispersion laws against published values, each other and the bounds within which they may be used."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from osl_env.plumes.dispersion import BriggsOpenCountry, BriggsUrban, FixedDispersion, PasquillGifford

CLASSES: Any = "ABCDEF"
LAWS = (BriggsOpenCountry, BriggsUrban, PasquillGifford)

# Turner's Pasquill-Gifford fits as tabulated in Fundamentals of Air Pollution, Table 19-5: sigma_z (m) where a piece
# ends (km)
PUBLISHED_SIGMA_Z = {
    "A": {0.1: 14.0, 0.15: 21.4, 0.2: 29.3, 0.25: 37.7, 0.3: 47.4, 0.4: 71.2, 0.5: 104.7},
    "B": {0.2: 20.2, 0.4: 40.0},
    "D": {0.3: 12.1, 1.0: 32.1, 3.0: 65.1, 10.0: 134.9, 30.0: 251.2},
    "E": {0.1: 3.5, 0.3: 8.7, 1.0: 21.6, 2.0: 33.5, 4.0: 49.8, 10.0: 79.1, 20.0: 109.3, 40.0: 141.9},
    "F": {0.2: 4.1, 0.7: 10.9, 1.0: 14.0, 2.0: 21.6, 3.0: 27.0, 7.0: 40.0, 15.0: 54.9, 30.0: 68.8, 60.0: 83.3},
}


@pytest.mark.parametrize("stability", PUBLISHED_SIGMA_Z)
def test_pasquill_gifford_sigma_z_is_the_published_one(stability: Any) -> None:
    """To the last digit printed, give or take the half per cent to which the pieces meet."""
    table = PUBLISHED_SIGMA_Z[stability]
    _, sigma_z = PasquillGifford(stability=stability).sigmas(1000.0 * np.array(list(table)))
    np.testing.assert_allclose(sigma_z, list(table.values()), rtol=0.005, atol=0.05)


@pytest.mark.parametrize(
    ("stability", "published"), [("A", 209), ("B", 154), ("C", 103), ("D", 68), ("E", 51), ("F", 34)]
)
def test_pasquill_gifford_sigma_y_at_one_kilometre(stability: Any, published: float) -> None:
    """Turner's sigma_y = 1000 X tan(T) / 2.15 with T = c at 1 km: the plume's edge is at 2.15 sigma."""
    sigma_y, _ = PasquillGifford(stability=stability).sigmas(1000.0)
    assert sigma_y == pytest.approx(published, abs=0.5)


@pytest.mark.parametrize("stability", CLASSES)
def test_the_pieces_of_sigma_z_meet(stability: Any) -> None:
    law = PasquillGifford(stability=stability)
    breaks = law.law().pieces[:-1, 0] * 1000.0
    _, before = law.sigmas(breaks * (1 - 1e-9))
    _, after = law.sigmas(breaks * (1 + 1e-9))
    # 5000 m at 3.11 km are the cap of class A, which its last piece reaches (453.85 * 3.11^2.1166 = 5011 m)
    np.testing.assert_allclose(after, before, rtol=0.006)


def test_sigma_z_is_capped_at_five_kilometres() -> None:
    for stability in ("A", "B", "C"):
        assert PasquillGifford(stability=stability).sigmas(1e6)[1] == 5000.0


@pytest.mark.parametrize("stability", CLASSES)
def test_briggs_open_country_is_near_the_curves_it_was_fitted_to(stability: Any) -> None:
    """Within 20 % (sigma_y) and a factor of 2 (sigma_z) over 0.2 to 2 km, but for class A's steep sigma_z."""
    x = np.array([200.0, 500.0, 1000.0, 2000.0])
    briggs, curves = BriggsOpenCountry(stability=stability).sigmas(x), PasquillGifford(stability=stability).sigmas(x)
    np.testing.assert_allclose(briggs[0], curves[0], rtol=0.2)
    if stability != "A":
        assert np.all(np.abs(np.log2(briggs[1] / curves[1])) < 1)


def test_briggs_written_out() -> None:
    """Some of each table's entries, as printed."""
    x = np.array([50.0, 700.0, 4000.0])
    for law, sigma_y, sigma_z in (
        (BriggsOpenCountry(stability="A"), 0.22 * x * (1 + 0.0001 * x) ** -0.5, 0.20 * x),
        (BriggsOpenCountry(stability="B"), 0.16 * x * (1 + 0.0001 * x) ** -0.5, 0.12 * x),
        (BriggsOpenCountry(stability="C"), 0.11 * x * (1 + 0.0001 * x) ** -0.5, 0.08 * x * (1 + 0.0002 * x) ** -0.5),
        (BriggsOpenCountry(stability="D"), 0.08 * x * (1 + 0.0001 * x) ** -0.5, 0.06 * x * (1 + 0.0015 * x) ** -0.5),
        (BriggsOpenCountry(stability="E"), 0.06 * x * (1 + 0.0001 * x) ** -0.5, 0.03 * x / (1 + 0.0003 * x)),
        (BriggsOpenCountry(stability="F"), 0.04 * x * (1 + 0.0001 * x) ** -0.5, 0.016 * x / (1 + 0.0003 * x)),
        (BriggsUrban(stability="A"), 0.32 * x * (1 + 0.0004 * x) ** -0.5, 0.24 * x * (1 + 0.001 * x) ** 0.5),
        (BriggsUrban(stability="B"), 0.32 * x * (1 + 0.0004 * x) ** -0.5, 0.24 * x * (1 + 0.001 * x) ** 0.5),
        (BriggsUrban(stability="C"), 0.22 * x * (1 + 0.0004 * x) ** -0.5, 0.20 * x),
        (BriggsUrban(stability="D"), 0.16 * x * (1 + 0.0004 * x) ** -0.5, 0.14 * x * (1 + 0.0003 * x) ** -0.5),
        (BriggsUrban(stability="E"), 0.11 * x * (1 + 0.0004 * x) ** -0.5, 0.08 * x * (1 + 0.0015 * x) ** -0.5),
        (BriggsUrban(stability="F"), 0.11 * x * (1 + 0.0004 * x) ** -0.5, 0.08 * x * (1 + 0.0015 * x) ** -0.5),
    ):
        np.testing.assert_allclose(law.sigmas(x), (sigma_y, sigma_z), rtol=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("stability", CLASSES)
def test_puffs_grow_from_the_minimum_on(law: Any, stability: Any) -> None:
    """Also at no distance and at absurd ones; the pieces of sigma_z may step back by what they fail to meet."""
    distances = np.concatenate([[0.0], np.geomspace(1e-3, 1e9, 400)])
    sigma_y, sigma_z = law(stability=stability).sigmas(distances)
    assert (sigma_y[0], sigma_z[0]) == (0.5, 0.2)
    assert np.isfinite(sigma_y).all()
    assert np.isfinite(sigma_z).all()
    assert np.all(np.diff(sigma_y) >= 0)
    assert np.all(np.diff(sigma_z) >= -0.006 * sigma_z[:-1])


@pytest.mark.parametrize("law", LAWS)
def test_a_less_stable_class_spreads_no_less(law: Any) -> None:
    x = np.array([100.0, 1000.0, 3000.0])
    for less, more in itertools.pairwise(CLASSES):
        for wide, narrow in zip(law(stability=less).sigmas(x), law(stability=more).sigmas(x), strict=True):
            assert np.all(wide >= narrow)


def test_fixed_sigmas_grow_by_diffusion_alone() -> None:
    law = FixedDispersion(sigma_y=0.3, sigma_z=0.1, diffusivity_y=0.5, diffusivity_z=0.02)
    sigma_y, sigma_z = law.sigmas([0.0, 5.0, 1e6], [0.0, 4.0, 4.0])
    np.testing.assert_allclose(sigma_y**2, [0.09, 4.09, 4.09])
    np.testing.assert_allclose(sigma_z**2, [0.01, 0.17, 0.17])
    assert FixedDispersion().sigmas(10.0, 1e6) == (0.5, 0.2)


@pytest.mark.parametrize("values", [{"stability": "G"}, {"minimum_sigma_y": 0}, {"width": 1}])
def test_bad_parameters_are_refused(values: Any) -> None:
    with pytest.raises(ValidationError):
        PasquillGifford(**values)
