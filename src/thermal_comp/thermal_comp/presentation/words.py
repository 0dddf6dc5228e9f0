# SPDX-License-Identifier: Apache-2.0
"""Meanings of the words that verbs print beside the names of effects and findings."""

from __future__ import annotations

from collections.abc import Mapping

VERDICT_SENTENCES: Mapping[str, str] = {
    'complete': 'Verdict: no effect of the catalogue explains more of the residual than chance '
    'does; what is left is noise of the size the sensor has.',
    'changed': 'Verdict: coefficients stored in the model differ from those of these runs by more '
    'than both uncertainties, and by more than a quarter of the noise floor; `fit` them anew.',
    'ratio': 'Of a changed effect: its size now, as a multiple of the stored one.',
    'missing': 'Verdict: an effect is missing in the model, and of the catalogue only this one '
    'explains the residual; `add` or `auto` adds it.',
    'ambiguous': 'Verdict: an effect is missing, but several of the catalogue explain these runs '
    'equally well. Any of them corrects runs like these; what tells them apart stands beside '
    'them, and `next-experiment A B` plans the run that does.',
    'unexplained': 'Verdict: the residual depends on something (temperature, its rate, time, '
    'frequency), but no effect of the catalogue has this form. The dependence is shown; an effect '
    'of your own can be tried with --effects.',
    'unlogged': 'Verdict: the residual follows a quantity that was not recorded (a heater, the '
    'supply voltage, humidity …). Record the channel that is named and repeat the run.',
    'noise_above_reference': 'Verdict: nothing that depends on temperature or time is missing, '
    'but the noise is higher than that of the sensor class (or of --noise-reference MODEL): '
    'vibration, a wrong range, or a worn device.',
    'data_quality': 'Verdict: values were clipped, stuck, spiky, in another unit …; the rows are '
    'left out and counted, and should be explained before a model is trusted.',
    'clock': 'Finding: the clock that paces the samples follows the temperature, as such '
    'clocks do (100 ppm/K). The stamps hold it; no sensor fails for it. See `clock_temperature`.',
    'ambiguous_with': 'The other effects that explain the same residual: see `ambiguous`.',
    'depends_on': 'The variable a residual follows that no effect explains.',
    'evidence': 'How much better the data are explained with an effect than without it: twice the '
    'logarithm of the likelihood ratio, less a charge for its parameters. Above its threshold '
    '(`threshold`) an effect is named; 10 is strong, and it grows in proportion to the length of '
    'the recording and to the square of the effect, so that values of thousands are common.',
    'threshold': 'Evidence from which one effect, known in form, is believed with 85 %.',
    'probability': 'How much an explanation is believed once the data are seen: those of one '
    'sensor add up to 1. Of an effect: of all explanations it has a part in.',
    'explanations': 'What may explain the residual of a sensor: sets of effects, nothing, an '
    'effect that is not in the catalogue, a variable that was not logged; the fewest that hold '
    '95 % together.',
    'nothing': 'Explanation: the model lacks nothing; what is left is noise, or an error of the '
    'thermometer.',
    'not_in_catalogue': 'Explanation: the residual depends on something, in a form no effect of '
    'the catalogue has. An effect of your own can be tried with --effects.',
    'approximate': 'The equation of a named effect is probably only nearly right, by more than '
    'the noise or by less; its name is believed all the same.',
    'residual_rms': 'Root mean square of measured minus modelled error in the runs the model was '
    'fitted to, on means over a block, per axis.',
    'held_out_rms': 'Root mean square of measured minus predicted error on cycles the fit has not '
    'seen: what a model is worth on new data.',
    'noise_floor': 'What the residual would be if only the noise of the sensor were left.',
    'error_before': 'Held-out rms without the effect.',
    'error_after': 'Held-out rms with it.',
    'parts': 'Of an added effect: parts of the runs that were held out, one after the other.',
    'parts_lowered': 'In how many of them the effect lowers the error: half of them is chance.',
    'smallest_found': 'How small an effect of each kind would have been found in runs like these.',
    'worse': 'Why a model is not saved: something simpler leaves less on what was held out.',
    'unplaced': 'Samples of a topic that belong to no row of imu/data_raw, by topic.',
    'greyed_out': 'Effects that cannot be tried with these runs, with the reason: a channel that '
    'was not recorded, runs that are too short, too few orientations.',
    'undetermined': 'Parameters these runs cannot determine; they are left out of the model.',
    'undecided': 'Pairs of effects these runs cannot tell apart, and what would.',
    'identifiable': 'Whether recordings like these can determine a parameter at all.',
    'rivals': 'Effects that may act in place of the named one, with their probabilities.',
    'separable': 'Of next-experiment: the planned run tells the two effects apart.',
    'extrapolated': 'A die temperature was outside the range the model was fitted in: the '
    'modelled error runs on with the slope it has at the end of the range, its uncertainty grows '
    'with the distance.',
    'passed_on': 'Samples handed on as they came, because no fresh die temperature was known.',
    'applied_model': 'Device and hash of the thermal model that was subtracted from a recording '
    'or from published data; subtracting one twice is refused.',
    'measured': 'Root mean square of the error before any model, on means over a block: what '
    'temperature does.',
    'measured_rms': 'See `measured`.',
    'held_out': 'What a model is worth on new data, see `held_out_rms`.',
    'residual': 'Root mean square of what the model leaves, see `residual_rms`.',
    'floor': 'What the residual would be if only noise were left, see `noise_floor`.',
    'worst_phase': 'Phase of the thermal cycle in which most of the error is left.',
    'rms_of_20_s_means': 'Root mean square of means over blocks (of 20 s or less): what averages '
    'out is not counted.',
    'cannot_be_decided': 'Pairs of effects these runs cannot tell apart, see `undecided`.',
    'not_tried': 'Effects these runs cannot show, see `greyed_out`.',
    'needed': 'The evidence from which an effect is named, see `threshold`.',
    'supported': 'Of a claim of the paper: these runs show it, too.',
    'not_supported': 'Of a claim of the paper: these runs contradict it; the numbers stand below.',
    'untestable_here': 'Of a claim of the paper: these runs cannot show it (one device, one pose, '
    'no reference attitude …).',
    'untestable': 'See `untestable_here`.',
    'block': 'Mean over 20 s, in runs shorter than 2¼ h over less, so that there are 400 of '
    'them; errors are quoted on these.',
    'cycle': 'One way of the temperature up and down; cycles are held out one at a time.',
    'precondition': 'Phase: still at the reference temperature before the first cycle.',
    'ramp_down': 'Phase: the set-point falls at a steady rate.',
    'dwell_cold': 'Phase: the set-point stands at the lowest temperature.',
    'ramp_up': 'Phase: the set-point rises at a steady rate.',
    'dwell_hot': 'Phase: the set-point stands at the highest temperature.',
    'dwell_reference': 'Phase: the set-point stands between the extremes, where a cycle ends.',
    'final': 'Phase: what follows the last cycle.',
    'chamber_temperature': 'Channel: air in the chamber [°C].',
    'chamber_temperature_2': 'Channel: air in the chamber, a second sensor [°C].',
    'device_temperature': 'Channel: a thermocouple on the device [°C].',
    'setpoint': 'Channel: where the chamber is told to go [°C].',
    'heater': 'Channel: state or duty of the heater, 0 … 1.',
    'compressor': 'Channel: state of the compressor, 0 … 1.',
    'fan': 'Channel: state of the fan, 0 … 1.',
    'pressure': 'Channel: air at the device, as a barometer on its board has it [Pa].',
    'supply_voltage': 'Channel: supply of the device [V].',
    'vibration': 'Channel: variance of the acceleration within a second [(m/s²)²].',
    'phase': 'Part of a thermal cycle: precondition, ramp_down, dwell_cold, ramp_up, dwell_hot, '
    'dwell_reference, final.',
    'branch': 'Cooling or heating: the error at one temperature differs between them where there '
    'is a lag or a hysteresis.',
    'pooled': 'One model fitted to several devices.',
    'stale': 'Of the node: the newest sample had no fresh die temperature; it is passed on.',
    'outside': 'Of the node: the die temperature is outside the fitted range, see `extrapolated`.',
    'not_applied': 'Of the node: effects of the model whose channel does not come.',
    'history': 'Of the node: what effects with a memory know of the time before: kept, restored '
    'from the state file, lost (they begin anew) or not needed.',
    'damaged': 'Of the node: single samples that no sensor measures; they are passed on.',
    'field_jump': 'Of check-tables: the level of the field changes between segments: something '
    'magnetic moved, or the device did.',
    'repeated_columns': 'Of check-tables: two devices share numbers that chance does not repeat.',
    'total': 'Of orient: the whole angle between estimated and reference attitude.',
    'heading': 'Of orient: the part of the angle about the vertical.',
    'inclination': 'Of orient: the part of the angle off the vertical.',
    'raw': 'As it was measured, nothing subtracted.',
    'compensated': 'With the modelled error subtracted.',
    'complementary': 'Filter: complementary filter of angular velocity, gravity and field.',
    'ahrs': 'Filter: Kalman filter of attitude and gyroscope bias.',
    'paper': 'Preset of a filter: as Betta et al. 2022 describe it.',
    'robust': 'Preset of a filter: as well as we can make it.',
    'gained': 'Of orient: by how much the angle to the reference attitude fell.',
    'moved': 'Of orient: the angle between the raw and the compensated run: what the temperature '
    'error did to the attitude.',
}
"""Word → what it means, in a sentence or two."""
