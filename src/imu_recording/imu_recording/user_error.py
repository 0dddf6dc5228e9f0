# SPDX-License-Identifier: Apache-2.0
"""The root of every error that a user's data, files or arguments cause."""


class UserError(ValueError):
    """A mistake the user can mend; the message is one line that names the value and a way out.

    Front ends show the message and exit with 2; any other error is a bug, with its traceback.
    """
