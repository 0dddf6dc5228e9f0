# SPDX-License-Identifier: Apache-2.0
"""Errors that a user's data, files, arguments or wiring cause, with a way out."""

from __future__ import annotations

import difflib
import errno
import os
from collections.abc import Iterable

LEAST_PART_LETTERS = 3
"""Least number of letters of a word from which a longer one that holds it is guessed."""


class UserError(ValueError):
    """A mistake the user can mend; the message is one line that names the value and a way out.

    Front ends show the message and exit with 2; any other error is a bug, with its traceback.
    """


ADVICE_OF_PORT_ERROR = {
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
    if number in ADVICE_OF_PORT_ERROR:
        return f'{port}: {ADVICE_OF_PORT_ERROR[number]}'
    return f'{port}: {os.strerror(number) if number else error}'


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return the word most like a mistyped one, or holding it, as a question, '' without one.

    >>> did_you_mean('termal_lag', ['thermal_lag', 'warm_up'])
    ' (did you mean thermal_lag?)'
    >>> did_you_mean('lag', ['warm_up', 'thermal_lag'])
    ' (did you mean thermal_lag?)'
    """
    listed = list(known)
    within = [name for name in listed if len(word) >= LEAST_PART_LETTERS and word in name]
    near = difflib.get_close_matches(word, listed, n=1) or within
    return f' (did you mean {near[0]}?)' if near else ''


def fault_in_yaml(error: Exception) -> str:
    r"""Return the line and what is wrong in it from the error of reading a YAML file.

    >>> import yaml
    >>> try:
    ...     yaml.safe_load('a: 1\nb: [1, 2\n')
    ... except yaml.YAMLError as error:
    ...     fault_in_yaml(error)
    "line 3: expected ',' or ']', but got '<stream end>'"
    """
    mark = getattr(error, 'problem_mark', None)
    problem = getattr(error, 'problem', None) or ' '.join(str(error).split())
    return f'line {mark.line + 1}: {problem}' if mark else problem
