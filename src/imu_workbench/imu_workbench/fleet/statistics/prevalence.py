# SPDX-License-Identifier: Apache-2.0
"""Which effects a lot has, in which share of its devices: joint evidence of all of them.

Where an effect is absent, what it takes up of a device's whitened residual is χ² with p degrees of
freedom; where it is present, its coefficients are the device's own, drawn with g times the
variance of their estimate, and it is (1 + g) χ²_p. With one form of the effect for the lot and a
share π of devices that have it, the Bayes factor against "none has it" is
Σ_i ln(1 − π + π B_i),  ln B_i = S_i g / (2 (1 + g)) − p ln(1 + g) / 2,
averaged over a grid of forms, ln g and π. So an effect that no device shows alone is named by
many.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from imu_recording.recording import FloatArray
from scipy.special import logsumexp

from imu_workbench.fleet.table import FleetTable

DEVICE_SHARES = np.linspace(0.025, 1.0, 40)
"""Grid of π, all equally probable beforehand."""
VARIANCE_RATIOS = np.geomspace(0.25, 1e5, 24)
"""Grid of g."""
NAMED_PROBABILITY = 0.95
"""Probability from which an effect is named."""
ALONE_LOG_BAYES_FACTOR = 3.0
"""ln of the Bayes factor from which a device shows an effect by itself."""


@dataclass(frozen=True)
class Prevalence:
    """One effect in one sensor of a lot."""

    type: str
    lot: str
    sensor: str
    effect: str
    form: str
    """Its shape parameters, the most probable of the grid."""
    devices: int
    evidence: float
    """ln of the joint Bayes factor against none."""
    probability: float
    """Probability that it acts, one at most of the effects tried in this sensor."""
    share: float
    """Share of the devices that have it."""
    share_range: tuple[float, float]
    """90 % interval of the share."""
    alone: int
    """Devices that show it by themselves."""

    @property
    def named(self) -> bool:
        """Whether it is probable enough to be named."""
        return self.probability >= NAMED_PROBABILITY


def joint_evidence(delta_chi2: FloatArray, degrees: int) -> tuple[FloatArray, FloatArray]:
    """Return (forms, g, π) ln Bayes factors of a lot and (n, forms, g) those of the devices.

    `delta_chi2` (n, forms) is what each form takes up of a device, with `degrees` of freedom.
    """
    single = (
        delta_chi2[:, :, None] * (VARIANCE_RATIOS / (1.0 + VARIANCE_RATIOS)) / 2.0
        - degrees * np.log1p(VARIANCE_RATIOS) / 2.0
    )
    joint = np.empty((*single.shape[1:], len(DEVICE_SHARES)))
    for k, share in enumerate(DEVICE_SHARES):
        mixed = np.logaddexp(np.log1p(-share) if share < 1.0 else -np.inf, np.log(share) + single)
        joint[:, :, k] = mixed.sum(axis=0)
    return joint, single


def prevalences(table: FleetTable, odd: Collection[tuple[str, str]] = ()) -> list[Prevalence]:
    """Return every effect tried, by type, lot and sensor, the most probable first.

    `odd` (device, sensor) are left out: what only they have is no property of the lot.
    """
    groups = table.rows(
        "SELECT DISTINCT type, lot, sensor FROM results WHERE role = 'candidate' ORDER BY ALL"
    )
    found: list[Prevalence] = []
    for kind, lot, sensor in groups:
        tried = [one for one in _tried(table, (kind, lot, sensor), odd) if one.devices]
        total = logsumexp([np.log(max(1, len(tried))), *(one.evidence for one in tried)])
        for one in sorted(tried, key=lambda one: -one.evidence):
            probability = float(np.exp(one.evidence - total))
            found.append(Prevalence(**{**vars(one), 'probability': probability}))
    return found


def _tried(
    table: FleetTable, where: tuple[str, str, str], odd: Collection[tuple[str, str]]
) -> list[Prevalence]:
    kind, lot, sensor = where
    every = table.rows(
        """SELECT effect, any_value(forms), sum(degrees), list(gain ORDER BY axis),
                  any_value(device)
           FROM results
           WHERE role = 'candidate' AND type = $kind AND lot = $lot AND sensor = $sensor
           GROUP BY effect, source HAVING count(*) = 3 ORDER BY effect""",
        kind=kind,
        lot=lot,
        sensor=sensor,
    )
    rows = [row for row in every if (row[4], sensor) not in odd]
    found = []
    for effect in dict.fromkeys(row[0] for row in rows):
        own = [row for row in rows if row[0] == effect]
        delta_chi2 = np.array([row[3] for row in own], dtype=float).sum(axis=1)
        shown = np.isfinite(delta_chi2).all(axis=0)
        forms = [form for form, seen in zip(own[0][1], shown, strict=True) if seen]
        if forms:
            delta_chi2 = delta_chi2[:, np.flatnonzero(shown)]
            found.append(_of_effect((*where, effect), forms, delta_chi2, int(own[0][2])))
    return found


def _of_effect(
    where: tuple[str, str, str, str], forms: Sequence[str], delta_chi2: FloatArray, degrees: int
) -> Prevalence:
    joint, single = joint_evidence(delta_chi2, degrees)
    evidence = float(logsumexp(joint) - np.log(joint.size))
    weight = np.exp(joint - joint.max())
    weight /= weight.sum()
    share = weight.sum(axis=(0, 1))
    below = np.cumsum(share)
    form, rest = divmod(int(np.argmax(joint)), joint[0].size)
    ratio = rest // len(DEVICE_SHARES)
    return Prevalence(
        *where,
        form=forms[form],
        devices=len(delta_chi2),
        evidence=evidence,
        probability=0.0,
        share=float(share @ DEVICE_SHARES),
        share_range=(
            float(DEVICE_SHARES[np.searchsorted(below, 0.05)]),
            float(DEVICE_SHARES[min(int(np.searchsorted(below, 0.95)), len(DEVICE_SHARES) - 1)]),
        ),
        alone=int((single[:, form, ratio] > ALONE_LOG_BAYES_FACTOR).sum()),
    )
