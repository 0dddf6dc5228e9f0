# SPDX-License-Identifier: Apache-2.0
"""Names in campaigns of the independent simulator that were lost to a law without one."""

from independent_simulator.campaign import draw_campaign

import thermal_comp as tc


def test_a_line_in_bursts_keeps_its_name() -> None:
    # Beside effects that explain nothing, a line that wanders was a law outside the catalogue.
    campaign = draw_campaign(3743, 'bursts')
    assert [effect['name'] for effect in campaign.truth.to_dict()['effects']] == ['mains_alias']
    found = [e for e in tc.diagnose(campaign.recordings).to_dict()['explanations']
             if e['sensor'] == 'gyroscope']  # fmt: skip
    assert found[0]['names'] == ['mains_alias']
    assert found[0]['probability'] > 0.5
