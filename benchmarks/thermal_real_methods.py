# SPDX-License-Identifier: Apache-2.0
"""Methods that `thermal_real.py` compares: peers that see temperatures, and ours."""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from imu_recording.recording import SENSOR_FIELDS, FloatArray
from imu_workbench.__main__ import main as workbench
from pysindy.feature_library import PolynomialLibrary
from pysindy.optimizers import STLSQ
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from thermal_comp.model.values import ThermalModel
from thermal_real_cases import BLOCKS, Fold, Mask

import thermal_comp as tc
from imu_recording import ImuRecording, write_bag

GP_ROWS = 700
"""Most rows a Gaussian process is fitted to: its time grows with their cube."""
THRESHOLDS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3)
"""Coefficients of standardised features that SINDy may leave out below; by cross-validation."""
HAND_MADE = ('bias_temperature', 'bias_temperature_curvature', 'thermal_lag_two_stage')

Predictor = Callable[[FloatArray, FloatArray, FloatArray], tuple[FloatArray, int]]
"""(features seen, error of one axis seen, all features) → prediction of all blocks, numbers."""


def linear(design: Callable[[FloatArray], FloatArray]) -> Predictor:
    """Return the least-squares fit of a design and a level."""

    def predict(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
        columns = np.column_stack([np.ones(len(seen)), design(seen)])
        found = np.linalg.lstsq(columns, error, rcond=None)[0]
        return np.column_stack([np.ones(len(every)), design(every)]) @ found, len(found)

    return predict


def _cubic(features: FloatArray) -> FloatArray:
    scaled = features[:, 0] / 50.0
    return np.column_stack([scaled, scaled**2, scaled**3])


LINE = linear(lambda features: features[:, :1])


def standardised(seen: FloatArray, every: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return both with mean 0 and deviation 1 over what the fit sees."""
    mean, spread = seen.mean(axis=0), np.maximum(seen.std(axis=0), 1e-9)
    return (seen - mean) / spread, (every - mean) / spread


def beside_line(fit: Callable[[FloatArray, FloatArray], Any], size: Callable[[Any], int]) -> Any:
    """Return the predictor that fits what a line leaves with a scikit-learn regressor."""

    def predict(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
        line = LINE(seen, error, seen)[0]
        scale = float((error - line).std()) or 1.0
        inside, outside = standardised(seen, every)
        fitted = fit(inside, (error - line) / scale)
        return LINE(seen, error, every)[0] + scale * fitted.predict(outside), 2 + size(fitted)

    return predict


def _gaussian_process(inside: FloatArray, error: FloatArray) -> GaussianProcessRegressor:
    kernel = ConstantKernel(1.0, (1e-4, 1e4)) * RBF(
        np.ones(inside.shape[1]), (1e-1, 1e3)
    ) + WhiteKernel(0.1, (1e-6, 1e2))
    thinned = slice(None, None, -(-len(inside) // GP_ROWS))
    return GaussianProcessRegressor(kernel).fit(inside[thinned], error[thinned])


def _boosted(inside: FloatArray, error: FloatArray) -> HistGradientBoostingRegressor:
    return HistGradientBoostingRegressor(random_state=1).fit(inside, error)


def sindy(seen: FloatArray, error: FloatArray, every: FloatArray) -> tuple[FloatArray, int]:
    """Return the sparse polynomial of degree 3 in all features (Brunton et al. 2016).

    The threshold is that with the least error over five contiguous parts of what is seen.
    """
    inside, outside = standardised(seen, every)
    library = PolynomialLibrary(degree=3).fit(inside)
    columns = np.asarray(library.transform(inside))
    mean, scale = float(error.mean()), float(error.std()) or 1.0
    wanted = (error - mean) / scale
    parts = np.arange(len(wanted)) * BLOCKS // len(wanted)

    def sparse(rows: Mask, threshold: float) -> FloatArray:
        found = STLSQ(threshold=threshold, alpha=0.05).fit(columns[rows], wanted[rows, None])
        coefficients: FloatArray = found.coef_[0]
        return coefficients

    def missed(threshold: float) -> float:
        return sum(
            float(np.sum((wanted[held] - columns[held] @ sparse(~held, threshold)) ** 2))
            for held in (parts == k for k in range(BLOCKS))
        )

    chosen = sparse(parts >= 0, min(THRESHOLDS, key=missed))
    predicted = mean + scale * (np.asarray(library.transform(outside)) @ chosen)
    return predicted, 1 + int(np.count_nonzero(chosen))


PEERS: dict[str, Predictor] = {
    'raw': lambda _, error, every: (np.full(len(every), error.mean()), 0),
    'line': LINE,
    'cubic (PX4, ArduPilot)': linear(_cubic),
    'cubic + rate': linear(lambda f: np.column_stack([_cubic(f), 60.0 * f[:, 1]])),
    'Gaussian process': beside_line(
        _gaussian_process, lambda fitted: fitted.X_train_.size * 6 // 5
    ),
    'gradient boosting': beside_line(
        _boosted, lambda fitted: 2 * sum(len(t[0].nodes) for t in fitted._predictors)
    ),
    'SINDy': sindy,
}


def training_recording(fold: Fold) -> ImuRecording:
    """Return what a fit may see: rows around a held-out part keep their temperature alone."""
    kept = np.flatnonzero(fold.train)
    first, last = int(kept[0]), int(kept[-1]) + 1
    part = fold.recording.rows(slice(first, last))
    hidden = ~fold.train[first:last]
    if not hidden.any():
        return part
    blank: dict[str, Any] = {
        field: np.where(hidden[:, None], np.nan, getattr(part, field))
        for field in SENSOR_FIELDS.values()
    }
    return replace(part, **blank)


def fit_named(recording: ImuRecording) -> ThermalModel:
    """Return the model with what a diagnosis names, as the verb `auto` adds it."""
    return _automatic(recording, '--named-only')


def fit_predictive(recording: ImuRecording) -> ThermalModel:
    """Return the model that the verb `auto` ends with."""
    return _automatic(recording)


def _automatic(recording: ImuRecording, *options: str) -> ThermalModel:
    with tempfile.TemporaryDirectory() as folder:
        bag, target = Path(folder, 'bag'), Path(folder, 'model.yaml')
        write_bag(recording, bag)
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            code = workbench(['auto', str(bag), '-o', str(target), '--force', *options])
        if code:
            raise RuntimeError(f'auto ended with exit code {code}: {said.getvalue()[-500:]}')
        return tc.load(target)


def fit_by_hand(recording: ImuRecording) -> ThermalModel:
    """Return the model that a person would try first: curvature and a two-stage lag."""
    return tc.fit([recording], HAND_MADE)


OURS = {
    'ours, by hand': fit_by_hand,
    'ours, named': fit_named,
    'ours, predictive': fit_predictive,
}


def numbers_stored(model: ThermalModel, sensor: str) -> int:
    """Return how many numbers predict one axis: coefficients, shape parameters, the level."""
    known = model.sensors[sensor]
    shapes = sum(
        int(np.size(getattr(effect, item.name)))
        for effect in known.effects
        for item in fields(effect)
    )
    return 1 + shapes + sum(len(coefficients) for coefficients in known.coefficients)
