# SPDX-License-Identifier: Apache-2.0
"""Forward selection of effects that lower the error on held-out parts, whatever its cause.

The form of an effect is chosen anew for each part that is held out, without that part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations

import numpy as np
from imu_recording.recording import FloatArray, IntArray

from thermal_comp.data.conditions import Sensor, logged_channels
from thermal_comp.data.improvement import LEAST_FALL, falls, falls_enough, may_fall
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Campaign, Effect
from thermal_comp.fitting.part_sums import PartSums, part_sums
from thermal_comp.linear.columns import LEAST_NEW_POWER
from thermal_comp.linear.normal_equations import taken_out
from thermal_comp.model.values import NoiseModel

MOST_ADDED_EFFECTS = 3
"""Largest number of effects that a sensor gets without a decided cause."""
LEAST_RELATIVE_CHANGE = 1e-3
"""Relative change of held-out errors from which an effect changes anything."""

Forms = Mapping[str, Sequence[Effect]]
"""The forms of each effect that are tried."""


@dataclass(frozen=True, eq=False)
class Selection:
    """Effects beside those of the model, and the mean squares they leave on held-out pieces."""

    names: tuple[str, ...]
    chosen: Mapping[int, tuple[Effect, ...]]
    """The forms by the part that was held out; 0: none was."""
    errors: FloatArray
    """(k, 3) [unit²]."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects in the forms that fit all parts best."""
        return self.chosen[0]

    @property
    def size(self) -> int:
        """Number of their columns and shape parameters."""
        return sum(len(effect.coefficient_units) + effect.free_shapes for effect in self.effects)


def predictive_effects(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    known: Sequence[Effect],
    noise: NoiseModel,
    catalogue: Mapping[str, type[Effect]],
    candidates: Sequence[tuple[str, ...]] = (),
) -> tuple[Effect, ...]:
    """Return the effects beside the `known` ones that lower the held-out error most.

    One effect is added after the other, or two where no single one helps, at most
    MOST_ADDED_EFFECTS, while the error falls by more than chance, on longer parts, too, and rises
    on no axis. Only effects without a channel beside temperature are tried, since the field may
    lack it; the sets of names in `candidates` are tried as wholes.
    """
    forms = usable_forms(runs, sensor, known, catalogue)
    if not forms:
        return ()
    live = {
        name: with_live_forms(runs, sensor, (*known, some[0]), noise)[-1:]
        for name, some in forms.items()
        if len(some[0].live_forms()) > 1
    }
    forms = {**forms, **live}
    every = dict.fromkeys(p for some in forms.values() for form in some for p in form.parts())
    sums = part_sums(runs, sensor, known, tuple(every), noise)
    start = _added(sums, forms, None, ())
    best = current = start
    names = [name for name in forms if not catalogue[name].channels]
    while len(current.names) < MOST_ADDED_EFFECTS and may_fall(current.errors, sums.variance):
        left = [name for name in names if name not in current.names]
        single = [_added(sums, forms, current, (name,)) for name in left]
        further = _best(sums, forms, current, single)
        if further is None and len(current.names) + 2 <= MOST_ADDED_EFFECTS:
            left = [n for n, s in zip(left, single, strict=True) if _differs(s, current)]
            pairs = [_added(sums, forms, current, pair) for pair in combinations(left, 2)]
            further = _best(sums, forms, current, pairs)
        if further is None:
            break
        best = current = further
    whole = [_added(sums, forms, start, names) for names in candidates if set(names) <= set(forms)]
    better = _best(sums, forms, start, [s for s in whole if _total(sums, s) < _total(sums, best)])
    return (better or best).effects


def best_held_out(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    forms: Sequence[tuple[Effect, ...]],
    noise: NoiseModel,
) -> tuple[Effect, ...]:
    """Return the effects, in the forms given, that leave the smallest error on held-out parts.

    Shapes stand as they are, coefficients are fitted without the part; the first of equals.
    """
    return min(forms, key=partial(_held_out_error, runs, sensor, noise))


def _held_out_error(
    runs: Sequence[PreparedRun], sensor: Sensor, noise: NoiseModel, effects: tuple[Effect, ...]
) -> float:
    """Return the sum of squares that effects leave on held-out parts, over the noise's."""
    sums = part_sums(runs, sensor, effects, (), noise)
    errors = [sums.errors(part, sums.known) for part in sums.parts()]
    return float((np.concatenate(errors) / sums.variance).sum())


def with_live_forms(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect], noise: NoiseModel
) -> tuple[Effect, ...]:
    """Return the effects, each in the live form that leaves the least on held-out parts.

    Where one has a prior of its coefficients (an empirical term) all stay as they are.
    """
    chosen = tuple(effects)
    if any(effect.coefficient_deviations() is not None for effect in effects):
        return chosen
    for place, effect in enumerate(effects):
        forms = effect.live_forms()
        if len(forms) > 1:
            tried = [(*chosen[:place], form, *chosen[place + 1 :]) for form in forms]
            chosen = best_held_out(runs, sensor, tried, noise)
    return chosen


def usable_forms(
    runs: Sequence[PreparedRun],
    sensor: Sensor,
    known: Sequence[Effect],
    catalogue: Mapping[str, type[Effect]],
) -> Forms:
    """Return the forms of the device effects of temperature and its history that can be tried."""
    logged = logged_channels([run.conditions for run in runs])
    campaign = Campaign(
        cycles=max(int(run.cycle.max()) for run in runs),
        durations=tuple(float(run.time[-1]) for run in runs),
        times_before=tuple(run.conditions.time_before for run in runs),
        spectral_lines=list,
        step_times=list,
        channels=logged,
    )
    there = {effect.name for effect in known}
    forms = {
        name: [c.effect for c in effect.search_grid(campaign) if c.run is None]
        for name, effect in catalogue.items()
        if effect.searched
        and effect.kind == 'device'
        and sensor in effect.sensors
        and name not in there
        and not (effect.per_run or effect.coupled or effect.time_only)
        and not effect.lacking(logged)
    }
    return {name: some for name, some in forms.items() if some}


def _best(
    sums: PartSums, forms: Forms, before: Selection, tried: Sequence[Selection]
) -> Selection | None:
    """Return the smallest selection that lowers the held-out error most; None: none does."""
    lower = [
        s
        for s in tried
        if _falls(sums, before, s)
        and (s.errors.sum(axis=0) <= (1.0 + LEAST_FALL) ** 2 * before.errors.sum(axis=0)).all()
        and _falls_on_longer(sums, forms, before, s)
    ]
    least = min(lower, key=lambda s: _total(sums, s), default=None)
    if least is None:
        return None
    enough = _total(sums, least) / (1.0 - LEAST_FALL) ** 2
    alike = [s for s in lower if _total(sums, s) <= enough]
    return min(alike, key=lambda s: (s.size, _total(sums, s)))


def _falls(sums: PartSums, before: Selection, after: Selection) -> bool:
    """Tell whether the errors of all axes together fall, in units of their noise."""
    return falls(before.errors, after.errors, sums.variance)


def _falls_on_longer(sums: PartSums, forms: Forms, before: Selection, after: Selection) -> bool:
    """Tell whether the error falls on longer parts, too; forms are chosen without each of them."""
    longer = sums.longer()
    if longer is sums:
        return True
    return falls_enough(
        *(_total(longer, _added(longer, forms, None, s.names)) for s in (before, after))
    )


def _differs(one: Selection, other: Selection) -> bool:
    """Tell whether two selections leave different errors."""
    return not np.allclose(one.errors, other.errors, rtol=LEAST_RELATIVE_CHANGE, atol=0.0)


def _total(sums: PartSums, selection: Selection) -> float:
    return float((selection.errors / sums.variance).sum())


def _added(
    sums: PartSums, forms: Forms, before: Selection | None, names: Sequence[str]
) -> Selection:
    """Return a selection with further effects, each in its best form for the rest of the parts."""
    chosen: dict[int, tuple[Effect, ...]] = {}
    errors = []
    for part in (0, *sums.parts()):
        effects = before.chosen[part] if before else ()
        training = sums.training(part)
        before_these = len(effects)
        for name in names:
            effects = (*effects, _best_form(sums, training, effects, forms[name]))
        for k, name in enumerate(names[:-1], before_these):
            others = (*effects[:k], *effects[k + 1 :])
            again = _best_form(sums, training, others, forms[name])
            effects = (*effects[:k], again, *effects[k + 1 :])
        chosen[part] = effects
        if part:
            errors.append(sums.errors(part, columns_of(sums, effects)))
    listed = (*(before.names if before else ()), *names)
    return Selection(listed, chosen, np.concatenate(errors))


def columns_of(sums: PartSums, effects: Sequence[Effect]) -> IntArray:
    """Return the columns of the known effects and of these."""
    parts = dict.fromkeys(part for effect in effects for part in effect.parts())
    return np.concatenate([sums.known, *(sums.places[part] for part in parts)])


def _best_form(
    sums: PartSums, training: FloatArray, beside: Sequence[Effect], forms: Sequence[Effect]
) -> Effect:
    """Return the form that lowers the sum of squares of the training parts most."""
    if len(forms) == 1:
        return forms[0]
    known = columns_of(sums, beside)
    left = [taken_out(training[axis], known)[0] for axis in range(3)]
    places = [np.concatenate([sums.places[part] for part in form.parts()]) for form in forms]
    criterion = np.zeros(len(forms))
    for width in {len(place) for place in places}:
        which = [k for k, place in enumerate(places) if len(place) == width]
        at = np.array([places[k] for k in which])
        for axis in range(3):
            full = np.diag(training[axis])[at]
            normal = left[axis][at[:, :, None], at[:, None, :]]
            normal[:, np.arange(width), np.arange(width)] += LEAST_NEW_POWER * full + 1e-300
            moment = left[axis][at, -1]
            answer = np.linalg.solve(normal, moment[:, :, None])[:, :, 0]
            criterion[which] += (moment * answer).sum(axis=1) - width * np.log(sums.rows.sum())
    return forms[int(np.argmax(criterion))]
