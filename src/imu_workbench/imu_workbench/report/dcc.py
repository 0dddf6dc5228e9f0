# SPDX-License-Identifier: Apache-2.0
"""The certificate as a Digital Calibration Certificate: XML after PTB's schema, units after D-SI.

Structure: https://ptb.de/dcc, version 3. Units: SmartCom "Digital System of Units" (D-SI).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from imu_recording.user_error import UserError

from imu_workbench.report.certificate.budget import COVERAGE_PROBABILITY
from imu_workbench.report.laboratory import NOT_STATED
from imu_workbench.report.model_content import in_words

NO_COUNTRY = 'ZZ'
"""Country where none is stated: the schema requires one (ISO 3166-1, user-assigned)."""
DCC_VERSION = '3.0.0'
"""Version of the schema where none is given."""
DCC, SI = 'https://ptb.de/dcc', 'https://ptb.de/si'
DSI_UNITS = {
    'm/s²': r'\metre\second\tothe{-2}',
    'rad/s': r'\radian\second\tothe{-1}',
    'T': r'\tesla',
    'rad': r'\radian',
    '1': '',
}
DSI_UNITS_PER_KELVIN = {
    '': '',
    '/K': r'\kelvin\tothe{-1}',
    '/K²': r'\kelvin\tothe{-2}',
    '/K³': r'\kelvin\tothe{-3}',
}
DSI_SHAPE_UNITS = {
    's': r'\second',
    'K': r'\kelvin',
    '°C': r'\degreecelsius',
    'Hz': r'\hertz',
    '1': r'\one',
}


def check_dcc(signed: bool) -> None:
    """Raise UserError naming the library that is missing and how to install it."""
    for name in ('lxml', *(('signxml',) if signed else ())):
        if find_spec(name) is None:
            raise UserError(f'a DCC needs {name}: pip install -r requirements-pdf.txt')


def dsi_unit(unit: str) -> str | None:
    r"""Return a coefficient's unit in D-SI's notation, None where it has no such form.

    >>> print(dsi_unit('rad/s/K'))
    \radian\second\tothe{-1}\kelvin\tothe{-1}
    >>> print(dsi_unit('1/K'), dsi_unit('1'))
    \kelvin\tothe{-1} \one
    """
    if unit in DSI_SHAPE_UNITS:
        return DSI_SHAPE_UNITS[unit]
    for name, written in DSI_UNITS.items():
        rest = unit.removeprefix(name)
        if unit.startswith(name) and rest in DSI_UNITS_PER_KELVIN:
            return written + DSI_UNITS_PER_KELVIN[rest]
    return None


def certificate_xml(content: Mapping[str, Any], version: str = DCC_VERSION) -> Any:
    """Return the certificate of the one device of a report as an lxml element.

    Raises UserError where it is not of one device.
    """
    certificates = content['certificates']
    if len(certificates) != 1:
        raise UserError(
            f'a DCC is of one device, these recordings are of {len(certificates)} with a model: '
            f'{", ".join(certificates) or "none"}'
        )
    found = next(iter(certificates.values()))
    from lxml.etree import Element

    root = Element(
        f'{{{DCC}}}digitalCalibrationCertificate',
        {'schemaVersion': version},
        nsmap={'dcc': DCC, 'si': SI},
    )
    _add(root, _administrative(found, content['reproduce']['versions']))
    results = _node('measurementResults', [_measurement(found)])
    _add(root, results)
    return root


Node = tuple[str, Any]
"""Name and text, or name and the nodes in it."""


def _node(name: str, inside: Any) -> Node:
    return name, inside


def _text(name: str, *texts: str) -> Node:
    return name, [('content', text) for text in texts]


def _add(parent: Any, node: Node) -> None:
    """Append a node and what is in it; names are of DCC unless they begin with `si:`."""
    from lxml.etree import SubElement

    name, inside = node
    space = SI if name.startswith('si:') else DCC
    element = SubElement(parent, f'{{{space}}}{name.removeprefix("si:")}')
    if isinstance(inside, str):
        element.text = inside
        if name == 'content':
            element.set('lang', 'en')
    else:
        for one in inside:
            _add(element, one)


def _country(laboratory: Mapping[str, Any]) -> str:
    return NO_COUNTRY if laboratory['country'] == NOT_STATED else str(laboratory['country'])


def unique_identifier(found: Mapping[str, Any]) -> str:
    """Return the certificate's number; where none is stated, a UUID of device and recordings."""
    number: str = found['laboratory']['number']
    if number != NOT_STATED:
        return number
    hashes = sorted(row['sha256'] for row in found['recordings'])
    return str(uuid5(uuid5(NAMESPACE_URL, DCC), ' '.join([found['device']['name'], *hashes])))


def _administrative(found: Mapping[str, Any], versions: Mapping[str, str]) -> Node:
    lab, device = found['laboratory'], found['device']
    days = sorted(row['start'][:10] for row in found['recordings'])
    if device['serial'] == NOT_STATED:  # the schema wants an identification: what recordings say
        identity = [('issuer', 'other'), ('value', device['name']), _text('name', 'recorded as')]
    else:
        identity = [
            ('issuer', 'manufacturer'), ('value', device['serial']), _text('name', 'serial'),
        ]  # fmt: skip
    received = lab['received']
    dates = [('receiptDate', received)] if re.match(r'\d{4}-', received) else []
    simulated = 'Simulated data: nothing here was measured.'
    stated = [simulated] if found['simulated'] else []
    if found['losses']:
        stated.append(f'Loss and damage of recordings: {"; ".join(found["losses"])}.')
    if lab['country'] == NOT_STATED:
        stated.append(f'Country of the laboratory: {NOT_STATED}; {NO_COUNTRY} stands for it.')
    return _node(
        'administrativeData',
        [
            _node('dccSoftware', [_node('software', _software(versions))]),
            _node(
                'coreData',
                [
                    ('countryCodeISO3166_1', _country(lab)),
                    ('usedLangCodeISO639_1', 'en'),
                    ('mandatoryLangCodeISO639_1', 'en'),
                    ('uniqueIdentifier', unique_identifier(found)),
                    *dates,
                    ('beginPerformanceDate', days[0]),
                    ('endPerformanceDate', days[-1]),
                    ('performanceLocation', 'other'),
                ],
            ),
            _node(
                'items',
                [
                    _node(
                        'item',
                        [
                            _text('name', device['name']),
                            _node('manufacturer', [_text('name', device['manufacturer'])]),
                            ('model', device['type']),
                            _node('identifications', [_node('identification', identity)]),
                        ],
                    )
                ],
            ),
            _node('calibrationLaboratory', [_node('contact', _contact(lab, 'name', 'address'))]),
            _node('respPersons', [_node('respPerson', _person(lab['operator']))]),
            _node('customer', _contact(lab, 'customer', 'customer')),
            _node(
                'statements',
                [
                    _node('statement', [_text('declaration', text)])
                    for text in [*stated, found['validity'], found['conclusion'], *_rule(found)]
                ],
            ),
        ],
    )


def _software(versions: Mapping[str, str]) -> list[Node]:
    return [_text('name', 'imu_workbench'), ('release', versions.get('imu_workbench', '') or '–')]


def _person(name: str) -> list[Node]:
    return [_node('person', [_text('name', name)]), ('role', 'operator')]


def _contact(lab: Mapping[str, Any], name: str, place: str) -> list[Node]:
    return [
        _text('name', lab[name]),
        ('eMail', 'not stated'),
        _node('location', [_text('further', lab[place])]),
    ]


def _rule(found: Mapping[str, Any]) -> list[str]:
    decided = [
        f'{d["sensor"]} {d["axis"]} {d["coefficient"]}: {d["decision"]}'
        + ('' if d['deciding'] is None else f', w {d["deciding"]:.3g} {d["unit"]}')
        for d in found['decisions']
    ]
    return [f'Decision rule: {found["rule"]}. {"; ".join(decided)}'] if decided else []


def _measurement(found: Mapping[str, Any]) -> Node:
    lab = found['laboratory']
    equipment = [
        _node(
            'measuringEquipment',
            [
                _text('name', f'{name}: {lab[name]["type"]}'),
                _text(
                    'description',
                    f'certificate {lab[name]["certificate"]}; uncertainty '
                    f'{lab[name]["uncertainty"]}',
                ),
            ],
        )
        for name in ('chamber', 'thermometer')
    ]
    conditions = '; '.join(f'{name}: {value}' for name, value in found['conditions'].items())
    recordings = '; '.join(
        f'{row["name"]} {row["start"]} UTC sha256 {row["sha256"]}' for row in found['recordings']
    )
    method = [
        _text('name', 'Thermal calibration at rest'),
        _text('description', *found['method']),
        ('norm', 'JCGM 100:2008'),
    ]
    return _node(
        'measurementResult',
        [
            _text('name', 'Temperature error of an inertial measurement unit'),
            _text('description', f'Recordings: {recordings}', f'Conditions: {conditions}'),
            _node('usedMethods', [_node('usedMethod', method)]),
            _node('measuringEquipments', equipment),
            _node('results', [_result(sensor, found) for sensor in _sensors(found)]),
        ],
    )


def _sensors(found: Mapping[str, Any]) -> list[str]:
    return list(dict.fromkeys(quantity['sensor'] for quantity in found['quantities']))


def _result(sensor: str, found: Mapping[str, Any]) -> Node:
    every = [*found['quantities'], *found['shapes']]
    rows = [_quantity(q) for q in every if q['sensor'] == sensor]
    return _node('result', [_text('name', sensor), _node('data', [_node('list', rows)])])


def _quantity(quantity: Mapping[str, Any]) -> Node:
    axis = '' if quantity['axis'] == 'all' else f', axis {quantity["axis"]}'
    name = f'{in_words(quantity["coefficient"])}{axis}'
    unit = dsi_unit(quantity['unit'])
    factor, std = quantity.get('coverage_factor', 2.0), quantity.get('combined')
    return _real(name, quantity['value'], std, factor, unit, quantity['unit'])


def _real(
    name: str, value: float, std: float | None, factor: float, unit: str | None, written: str
) -> Node:
    """Return a quantity ± factor · std; as text where its unit has no form in D-SI."""
    if unit is None:
        spread = f' ± {factor * std:.3g} (k = {factor:.4g})' if std else ''
        text = f'{value:.9g}{spread} {written}'
        return _node('quantity', [_text('name', name), _text('noQuantity', text)])
    uncertainty: Sequence[Node] = ()
    if std:
        uncertainty = [
            _node(
                'si:expandedUnc',
                [
                    ('si:uncertainty', f'{factor * std:.6g}'),
                    ('si:coverageFactor', f'{factor:.4g}'),
                    ('si:coverageProbability', f'{COVERAGE_PROBABILITY:g}'),
                ],
            )
        ]
    real = [('si:value', f'{value:.12g}'), ('si:unit', unit), *uncertainty]
    return _node('quantity', [_text('name', name), _node('si:real', real)])


def load_schema(path: Path) -> tuple[Any, str]:
    """Return the schema of a file and its version; what it imports lies in the same folder."""
    from lxml import etree

    missing: list[str] = []

    class Beside(etree.Resolver):  # type: ignore[misc]
        def resolve(self, url: str, _: str, context: Any) -> Any:
            if Path(url) == path:
                return None
            near = path.parent / url.rpartition('/')[2]
            if not near.is_file():
                missing.append(f'{path}: imports {url}; put {near.name} beside it')
                return None
            return self.resolve_filename(str(near), context)

    parser = etree.XMLParser(no_network=True)
    parser.resolvers.add(Beside())
    try:
        document = etree.parse(str(path), parser)
        schema = etree.XMLSchema(document)
    except (etree.XMLSyntaxError, etree.XMLSchemaParseError) as error:
        reason = missing[0] if missing else f'{path}: no schema that can be read: {error}'
        raise UserError(reason) from None
    if missing:
        raise UserError(missing[0])
    return schema, document.getroot().get('version') or DCC_VERSION


def validated(root: Any, schema: Any, path: Path) -> str:
    """Return a note that the certificate conforms to the schema; raise UserError with a fault."""
    if not schema.validate(root):
        fault = schema.error_log[0]
        raise UserError(f'{path}: the certificate does not hold to it: {fault.message}')
    return f'validated against {path}'


def signed(root: Any, key: Path, certificate: Path) -> Any:
    """Return the certificate with an enveloped XML signature (XMLDSig)."""
    from signxml import XMLSigner

    try:
        return XMLSigner().sign(root, key=key.read_bytes(), cert=certificate.read_text('ascii'))
    except (ValueError, TypeError) as error:
        raise UserError(f'{key}, {certificate}: no key and certificate in PEM: {error}') from None


def xml_bytes(root: Any) -> bytes:
    """Return the document."""
    from lxml.etree import tostring

    # A signature holds for the text as it stands: nothing is indented after it.
    written: bytes = tostring(root, xml_declaration=True, encoding='UTF-8')
    return written
