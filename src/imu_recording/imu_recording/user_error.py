# SPDX-License-Identifier: Apache-2.0
"""Errors that a user's data, files, arguments or wiring cause, with a way out."""

from __future__ import annotations

import errno
import os


class UserError(ValueError):
    """A mistake the user can mend; the message is one line that names the value and a way out.

    Front ends show the message and exit with 2; any other error is a bug, with its traceback.
    """


WAYS_OUT = {
    errno.ENOENT: 'no such device: is it plugged in and is this its port?',
    errno.EACCES: 'no permission: join the group the port belongs to (often dialout), log in anew',
    errno.EAGAIN: 'in use by another program: end that first',
    errno.EBUSY: 'in use by another program: end that first',
    errno.ECONNREFUSED: 'nobody listens there: is the device on, are host and port right?',
    errno.EHOSTUNREACH: 'the host cannot be reached: is it on the same network?',
}


def why_not_open(port: str, error: Exception) -> str:
    """Return one line about `port` from the error its opening raised.

    >>> why_not_open('/dev/imu', FileNotFoundError(2, 'could not open port /dev/imu'))
    '/dev/imu: no such device: is it plugged in and is this its port?'
    """
    number = getattr(error, 'errno', None)
    if number in WAYS_OUT:
        return f'{port}: {WAYS_OUT[number]}'
    return f'{port}: {os.strerror(number) if number else error}'
