# SPDX-License-Identifier: Apache-2.0
"""What is predicted where nothing is hidden."""

import pytest
from prediction_nulls import null_campaign, predicted


@pytest.mark.long
def test_columns_that_others_explain_add_nothing() -> None:
    # Of 20 min in which all settles alike, rounding was all that some columns had left.
    recordings, _ = null_campaign(6107)
    assert predicted(recordings) == {}
