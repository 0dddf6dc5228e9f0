# SPDX-License-Identifier: Apache-2.0
"""Sets of effects with their amplitudes: what a hypothesis about a sensor consists of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.diagnosis.evidence.candidates import Form
from thermal_comp.linear.candidate_design import CandidateDesign
from thermal_comp.linear.gaussian_evidence import CoefficientPrior, likeliest_coefficients

NOT_IN_CATALOGUE = 'not_in_catalogue'
UNLOGGED = 'unlogged'

Names = tuple[str, ...]
"""Names of the effects of a set, sorted; () is nothing."""


@dataclass(frozen=True, eq=False)
class Component:
    """One effect in one form, with the width of its amplitude's prior."""

    form: Form
    amplitude: float
    """Prior standard deviation of its largest coefficient [√Δχ²]."""
    forms: int
    """One over the prior of its form."""

    @property
    def name(self) -> str:
        """Catalogue name."""
        return self.form.effect.name

    @property
    def columns(self) -> tuple[int, ...]:
        """Columns of the design."""
        return self.form.columns

    @property
    def prior(self) -> CoefficientPrior:
        """Prior of its coefficients."""
        deviation = self.amplitude * np.array(self.form.relative)
        shared = self.form.terms[0].shared
        return CoefficientPrior(self.columns, shared=shared, deviation=deviation)


@dataclass(frozen=True, eq=False)
class EffectSet:
    """A set of effects as an explanation of one sensor's residual."""

    components: tuple[Component, ...]
    log_posterior: float
    """ln of prior times evidence, relative to nothing's evidence."""
    log_prior: float
    """ln of its prior, of the effects and of their amplitudes."""
    explained: float
    """Δχ² of the set together; 0 where it was not fitted."""

    @property
    def names(self) -> Names:
        """Names of its effects, sorted."""
        return tuple(sorted(c.name for c in self.components))

    def beside(self, known: EffectSet) -> EffectSet:
        """Return the set with effects that a model has already, and what they explain."""
        return replace(
            self,
            components=(*known.components, *self.components),
            explained=known.explained + self.explained,
        )

    @property
    def guessed(self) -> str:
        """Channel that an effect of the set guesses; '' where all were logged."""
        channels = (c.form.effect.guessed_channel for c in self.components)
        return next(filter(None, channels), '')


NO_EFFECT = EffectSet((), 0.0, 0.0, 0.0)


def fitted_coefficients(
    design: CandidateDesign, components: Sequence[Component], nuisances: Sequence[CoefficientPrior]
) -> list[FloatArray]:
    """Return by component the (3, p) likeliest coefficients of its columns of unit length."""
    allowed = [*(c.prior for c in components), *nuisances]
    known = design.products_among([c for prior in allowed for c in prior.columns])
    found = likeliest_coefficients(*known, allowed)
    ends = np.cumsum([len(c.columns) for c in components], dtype=int)
    return np.split(found[:, : ends[-1]], ends[:-1], axis=1) if components else []
