# SPDX-License-Identifier: Apache-2.0
"""Effects of the catalogue as explanations of a sensor's residual, most probable first."""

from __future__ import annotations

from collections.abc import Mapping
from math import log

from thermal_comp.data.conditions import Sensor
from thermal_comp.diagnosis.evidence.posterior import probability
from thermal_comp.diagnosis.evidence.priors import NOTHING
from thermal_comp.diagnosis.result import RankedEffect
from thermal_comp.diagnosis.sensor_answer import SensorAnswer


def ranked_effects(answers: Mapping[Sensor, SensorAnswer]) -> tuple[RankedEffect, ...]:
    """Return every effect that was weighed, sensor by sensor, most probable first.

    That it might stand beside others too small to be seen makes no effect a rival of theirs.
    """
    found: list[RankedEffect] = []
    for sensor, answer in answers.items():
        together = {effect.name: effect for effect in (*answer.named, *answer.closest)}
        alone = {s.names[0]: s for s in answer.sets if len(s.names) == 1 and not s.guessed}
        own = [
            RankedEffect(
                sensor,
                together.get(name, one.components[0].form.effect),
                probability(
                    answer.explanations,
                    lambda e, n=name: n in e.names and e.unseen != n,  # type: ignore[misc]
                ),
                one.log_posterior - log(NOTHING),
            )
            for name, one in alone.items()
        ]
        found += sorted(own, key=lambda r: (-round(r.probability, 12), -r.log_odds))
    return tuple(found)
