# SPDX-License-Identifier: Apache-2.0
"""The certificate and its annexes on paper: WeasyPrint lays the same templates out as pages."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any

from imu_recording.user_error import UserError

from imu_workbench.report.html.certificate import (
    allan_section,
    budget_section,
    certificate_section,
)
from imu_workbench.report.html.claims import reproduce_section
from imu_workbench.report.html.measured import recordings_section
from imu_workbench.report.html.modelled import model_section
from imu_workbench.report.html.render import Section, templates
from imu_workbench.report.laboratory import NOT_STATED

SYSTEM_LIBRARIES = 'apt install libpango-1.0-0 libpangoft2-1.0-0 libharfbuzz-subset0'
RUN_CAPTION = (
    'Temperatures over the run, and what the certified model leaves of each sensor’s error (block '
    'means).'
)
ALLAN_CAPTION = 'What the certified model leaves, all runs together; bands: 95 % interval.'


def check_pdf() -> None:
    """Raise UserError naming the library for PDF that is missing and how to install it."""
    missing = [name for name in ('weasyprint', 'matplotlib') if find_spec(name) is None]
    if missing:
        raise UserError(f'PDF needs {missing[0]}: pip install -r requirements-pdf.txt')
    try:
        import weasyprint  # noqa: F401 (it opens Pango when it is imported)
    except OSError as error:
        library = str(error).splitlines()[0]
        raise UserError(f'PDF needs Pango ({library}): {SYSTEM_LIBRARIES}') from None


def report_pdf(content: Mapping[str, Any]) -> bytes:
    """Return certificates and annexes as PDF: A4, numbered pages, every run."""
    check_pdf()
    from weasyprint import HTML

    pages = printed_page(content)
    found: bytes = HTML(string=pages).write_pdf()
    return found


def printed_page(content: Mapping[str, Any]) -> str:
    """Return what is printed as one HTML text, pictures included."""
    certificates = content['certificates']
    if not certificates:
        problems = '; '.join(d['problem'] for d in content['devices'] if d['problem'])
        raise UserError(f'no certificate: {problems}')
    annexes = (
        model_section(content),
        budget_section(certificates),
        allan_section(certificates),
        recordings_section(content),
        reproduce_section(content),
    )
    feet = [footer(found) for found in certificates.values()]
    title = feet[0] if len(feet) == 1 else f'Calibration certificates {", ".join(certificates)}'
    return (
        templates()
        .get_template('print.html')
        .render(
            title=title,
            certificates=list(
                zip(map(certificate_section, certificates.values()), feet, strict=True)
            ),
            pictures=list(pictures_of(content)),
            annexes=[section for section in annexes if isinstance(section, Section)],
            simulated=any(found['simulated'] for found in certificates.values()),
        )
    )


def footer(certificate: Mapping[str, Any]) -> str:
    """Return the foot of a certificate's pages: its device, and its number where stated."""
    number = certificate['laboratory']['number']
    told = '' if number == NOT_STATED else f', no. {number}'
    return f'Calibration certificate {certificate["device"]["name"]}{told}'


def pictures_of(content: Mapping[str, Any]) -> Iterator[dict[str, str]]:
    """Give a picture of every run that a certificate is about, and of what noise is left."""
    from imu_workbench.report.figures.printed import allan_picture, run_picture

    plans = {recording['name']: recording['plan'] for recording in content['recordings']}
    for device, found in content['certificates'].items():
        for run, residuals in found['residuals'].items():
            yield {
                'kind': 'run',
                'footer': footer(found),
                'title': f'run {run} of {device}',
                'caption': RUN_CAPTION,
                'source': as_source(run_picture(plans.get(run), residuals)),
            }
        if found['allan_deviation']:
            yield {
                'kind': 'annex',
                'footer': footer(found),
                'title': f'Allan deviation of {device}',
                'caption': ALLAN_CAPTION,
                'source': as_source(allan_picture(found['allan_deviation'])),
            }


def as_source(svg: str) -> str:
    """Return an SVG picture as the address of an image."""
    return f'data:image/svg+xml;base64,{base64.b64encode(svg.encode()).decode()}'
