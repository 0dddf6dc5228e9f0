# SPDX-License-Identifier: Apache-2.0
"""Clusters of devices: a Gaussian mixture with the number of components of the least BIC."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from imu_workbench.fleet.statistics.vectors import Vectors

MOST_CLUSTERS = 12
MOST_FITTED_DEVICES = 4000
"""Devices the mixture is fitted to; the others are assigned."""
WORSE_IN_A_ROW = 3
"""The search ends after so many numbers of clusters in a row without a smaller BIC."""
MIXTURE_SEED = 7


@dataclass(frozen=True, eq=False)
class Clusters:
    """A partition of the devices of one type."""

    count: int
    label: IntArray
    """(n,) cluster of each device, the largest first."""
    table: dict[int, dict[str, int]]
    """Cluster → lot → devices."""


def find_clusters(sensors: Sequence[Vectors], ordinary: Sequence[bool]) -> Clusters:
    """Return the clusters of the coefficients of all sensors (the same devices in each).

    The fit takes `ordinary` devices only, without their lots; every device is assigned.
    """
    values = np.hstack([vectors.coefficients for vectors in sensors])
    y = (values - np.median(values, axis=0)) / np.maximum(values.std(axis=0), 1e-300)
    seen = y[np.asarray(ordinary, dtype=bool)]
    draw = np.random.default_rng(MIXTURE_SEED)
    if len(seen) > MOST_FITTED_DEVICES:
        seen = seen[draw.choice(len(seen), MOST_FITTED_DEVICES, replace=False)]
    label = np.zeros(len(y), dtype=np.int64)
    if (mixture := _best_mixture(seen)) is not None:
        label = mixture.predict(y)
    names, sizes = np.unique(label, return_counts=True)
    rank = {int(name): place for place, name in enumerate(names[np.argsort(-sizes)])}
    ranked = np.array([rank[int(one)] for one in label], dtype=np.int64)
    lots = sensors[0].lot
    table = {
        place: {
            str(lot): int(((ranked == place) & (lots == lot)).sum()) for lot in np.unique(lots)
        }
        for place in sorted(set(rank.values()))
    }
    return Clusters(len(rank), ranked, table)


def _best_mixture(values: FloatArray) -> Any:
    """Return the mixture of the least BIC, of one covariance for all parts or one for each."""
    from sklearn.mixture import GaussianMixture

    found: list[tuple[float, Any]] = []
    for form in ('tied', 'full'):
        least, worse = np.inf, 0
        for count in range(1, min(MOST_CLUSTERS, len(values) // (2 * values.shape[1])) + 1):
            mixture = GaussianMixture(
                count, covariance_type=form, n_init=2, random_state=MIXTURE_SEED
            )
            bic = float(mixture.fit(values).bic(values))
            found.append((bic, mixture))
            worse = 0 if bic < least else worse + 1
            least = min(bic, least)
            if worse == WORSE_IN_A_ROW:
                break
    return min(found, key=lambda pair: pair[0])[1] if found else None
