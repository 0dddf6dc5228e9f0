# SPDX-License-Identifier: Apache-2.0
"""Everybody who looks is told of every message and job; a message stands once."""

from __future__ import annotations

from imu_workbench.web.work.notices import Notices


def test_a_message_stands_once_until_it_is_closed() -> None:
    notices = Notices()
    notices.say('a bag is cut off')
    notices.say('a bag is cut off')
    notices.say('read', 'info')
    assert [(m.text, m.kind) for m in notices.messages] == [
        ('read', 'info'),
        ('a bag is cut off', 'error'),
    ]
    notices.close_message(notices.messages[1].number)
    assert [m.text for m in notices.messages] == ['read']


def test_listeners_are_told_until_they_leave() -> None:
    notices, told = Notices(), []

    def listener() -> None:
        told.append(len(notices.messages))

    notices.listen(listener)
    notices.say('one')
    notices.leave(listener)
    notices.leave(listener)
    notices.say('two')
    assert told == [1]


def test_a_job_is_shown_while_it_is_under_way() -> None:
    class Reading:
        about = progress = ''
        began, expected_end = 0.0, None

        def cancel(self) -> None:
            """There is nothing to stop."""

    notices, job = Notices(), Reading()
    with notices.work(job, 'dut2 v1'):
        assert notices.jobs == [job]
        assert job.about == 'dut2 v1'
    assert notices.jobs == []
