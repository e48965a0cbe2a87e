"""A noise model as a run keeps it."""

from dataclasses import replace

import pytest

from lab.formats.noise_model import noise_model_from_dict, noise_model_to_dict
from lab.noise.error_model import Clock, ErrorModel


def sample(scatter: float = 0.0, wandering: float = 0.0, drift: float = 0.0) -> ErrorModel:
    sizes = {"scatter": scatter, "shift": wandering, "trend": drift}
    return ErrorModel(5e-6, 1.0, sizes, Clock(10.0, 10.0), {"tool.p1.x": 0.1}, 0.8)


def test_a_run_keeps_its_noise_model_for_another_day() -> None:
    shared = sample(scatter=30e-6, wandering=4e-6, drift=20e-6)
    kept = noise_model_to_dict(shared)
    assert kept is not None
    back = noise_model_from_dict(kept, shared.values)
    assert back == replace(shared, clock=None, sigma_m=pytest.approx(5e-6))
    assert noise_model_to_dict(None) is None and noise_model_from_dict(None, {}) is None
