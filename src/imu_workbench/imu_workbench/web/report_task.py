# SPDX-License-Identifier: Apache-2.0
"""The report of the models on the page."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from thermal_comp.effects.user_effects import effect_catalogue

from imu_workbench.provenance import versions
from imu_workbench.report.content import report_content
from imu_workbench.report.page import report_page
from imu_workbench.study import study_recordings
from imu_workbench.web.stored_bag import StoredBag
from imu_workbench.web.version import model_from_text


def report_task(
    progress: Callable[[str], None],
    bags: Sequence[StoredBag],
    model_texts: Mapping[str, str],
    effect_files: Sequence[Path],
    target: Path,
) -> Path:
    """Write the report of these recordings under these models (by device); return its path."""
    progress('writing the report: filters, diagnosis, figures')
    catalogue = effect_catalogue(effect_files)
    models = {device: model_from_text(text, catalogue) for device, text in model_texts.items()}
    recordings = [bag.recording() for bag in bags]
    study = study_recordings(recordings, models, catalogue=catalogue, workers=os.cpu_count() or 1)
    names = ' '.join(bag.source for bag in bags)
    given = [f'--model {device}.yaml' for device in models]
    given += [f'--effects {file.name}' for file in effect_files]
    command = f'python -m imu_workbench report {names} {" ".join(given)} -o report.html'
    content = report_content(study, commands=[command], versions=versions())
    target.write_text(report_page(content), 'utf-8')
    return target
