# SPDX-License-Identifier: Apache-2.0
"""The DCC says what the certificate says, in D-SI units, in the order of PTB's schema."""

import datetime as dt
from pathlib import Path
from uuid import UUID

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from imu_recording.user_error import UserError
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.dcc import (
    certificate_xml,
    dsi_unit,
    load_schema,
    signed,
    validated,
    xml_bytes,
)
from imu_workbench.report.laboratory import Laboratory
from lxml import etree
from scipy.stats import t as student
from signxml import SignatureConfiguration, XMLVerifier

NAMES = {'dcc': 'https://ptb.de/dcc', 'si': 'https://ptb.de/si'}
SCHEMA = """<xs:schema version="3.9.9" xmlns:xs="http://www.w3.org/2001/XMLSchema"
 targetNamespace="https://ptb.de/dcc" elementFormDefault="qualified">
<xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>
<xs:element name="administrativeData"/><xs:element name="{second}"/></xs:sequence>
<xs:attribute name="schemaVersion" fixed="3.9.9"/></xs:complexType></xs:element></xs:schema>"""


@pytest.fixture(scope='module')
def content(run):
    recordings = [run('dut1', up, seed=i, cycles=3) for i, up in enumerate('xz')]
    analysis = analyse_recordings(recordings, attitudes=False, diagnosis=False)
    lab = Laboratory({'laboratory': {'name': 'Example', 'country': 'XX'}})
    return report_content(analysis, commands=[], versions={}, laboratory=lab)


def found(root, path: str) -> list[str]:
    return root.xpath(f'{path}/text()', namespaces=NAMES)


def test_every_coefficient_is_there_with_its_uncertainty(content) -> None:
    root = certificate_xml(content)
    quantities = content['certificates']['dut1']['quantities']
    assert [float(v) for v in found(root, '//si:real/si:value')] == pytest.approx(
        [q['value'] for q in quantities]
    )
    uncertainties = [float(v) for v in found(root, '//si:expandedUnc/si:uncertainty')]
    factors = [float(v) for v in found(root, '//si:expandedUnc/si:coverageFactor')]
    for quantity, uncertainty, factor in zip(quantities, uncertainties, factors, strict=True):
        degrees = quantity['degrees']
        expected = float(student.ppf(0.975, 1e9 if degrees is None else degrees))
        assert factor == pytest.approx(expected, rel=1e-3)
        assert uncertainty == pytest.approx(expected * quantity['combined'], rel=1e-5)
    assert max(factors) > 2.1  # two runs tell some of them with few degrees of freedom
    assert set(found(root, '//si:expandedUnc/si:coverageProbability')) == {'0.95'}
    assert found(root, '//si:unit') == [dsi_unit(q['unit']) for q in quantities]
    assert found(root, '//dcc:coreData/dcc:beginPerformanceDate') == ['2023-11-14']
    assert root.get('schemaVersion') == '3.0.0'


def test_it_is_validated_against_the_file_that_is_given(content, tmp_path: Path) -> None:
    path = tmp_path / 'dcc.xsd'
    path.write_text(SCHEMA.format(second='measurementResults'))
    schema, version = load_schema(path)
    assert 'validated' in validated(certificate_xml(content, version), schema, path)
    path.write_text(SCHEMA.format(second='other'))
    with pytest.raises(UserError, match='measurementResults'):
        validated(certificate_xml(content, version), load_schema(path)[0], path)
    path.write_text('<xs:schema')
    with pytest.raises(UserError, match='no schema that can be read'):
        load_schema(path)


def test_a_schema_it_imports_lies_beside_it(tmp_path: Path) -> None:
    path = tmp_path / 'dcc.xsd'
    path.write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema"><xs:import '
        'namespace="https://ptb.de/si" schemaLocation="https://ptb.de/si/SI_Format.xsd"/></xs:schema>'
    )
    with pytest.raises(UserError, match=r'put SI_Format\.xsd beside it'):
        load_schema(path)


def test_a_country_that_is_not_stated_is_said_to_be_none(content) -> None:
    certificate = content['certificates']['dut1']
    laboratory = certificate['laboratory'] | {'country': 'not stated'}
    nowhere = {'dut1': certificate | {'laboratory': laboratory}}
    root = certificate_xml(content | {'certificates': nowhere})
    assert found(root, '//dcc:countryCodeISO3166_1') == ['ZZ']
    assert any('Country of the laboratory: not stated' in text for text in root.itertext())
    assert found(certificate_xml(content), '//dcc:countryCodeISO3166_1') == ['XX']
    with pytest.raises(UserError, match='of one device'):
        certificate_xml(content | {'certificates': {'a': certificate, 'b': certificate}})


def test_without_a_number_the_recordings_identify_the_certificate(content) -> None:
    def identifier(**changed) -> str:
        certificate = content['certificates']['dut1'] | changed
        root = certificate_xml(content | {'certificates': {'dut1': certificate}})
        (text,) = found(root, '//dcc:uniqueIdentifier')
        return text

    certificate = content['certificates']['dut1']
    own, rows = identifier(), certificate['recordings']
    assert UUID(own).version == 5
    assert own == identifier(recordings=rows[::-1])
    assert own != identifier(recordings=rows[1:])
    stated = certificate['laboratory'] | {'number': '2026-001'}
    assert identifier(laboratory=stated) == '2026-001'


def test_a_signature_holds_and_breaks(content, tmp_path: Path) -> None:
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, 'test')])
    start = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(7)
        .not_valid_before(start)
        .not_valid_after(start + dt.timedelta(days=36_500))
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    private = serialization.PrivateFormat.PKCS8
    paths = tmp_path / 'key.pem', tmp_path / 'certificate.pem'
    paths[0].write_bytes(key.private_bytes(pem, private, serialization.NoEncryption()))
    paths[1].write_bytes(certificate.public_bytes(pem))
    with pytest.raises(UserError, match='no key and certificate in PEM'):
        signed(certificate_xml(content), paths[1], paths[1])
    text = xml_bytes(signed(certificate_xml(content), *paths))
    expected = SignatureConfiguration(require_x509=True)
    options = {'x509_cert': certificate, 'expect_config': expected}
    XMLVerifier().verify(text, **options)
    root = etree.fromstring(text)
    root.find('.//si:value', NAMES).text = '0'
    with pytest.raises(Exception, match=r'[Dd]igest'):
        XMLVerifier().verify(etree.tostring(root), **options)
