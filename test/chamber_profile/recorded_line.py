# SPDX-License-Identifier: Apache-2.0
"""A line on which a chamber's answers are read from a list."""

from chamber_profile.chambers.chamber import ChamberError


class RecordedLine:
    """Expects the requests of `exchanges` in their order and returns their answers."""

    def __init__(self, *exchanges: tuple[bytes, bytes]) -> None:
        self.exchanges = list(exchanges)
        self.closed = 0

    def open(self) -> None:
        """There is nothing to open."""

    def close(self) -> None:
        self.closed += 1

    def ask(self, request: bytes, length) -> bytes:
        expected, answer = self.exchanges.pop(0)
        assert request == expected
        size = length(answer)
        if not size or len(answer) < size:
            raise ChamberError('no answer')
        return answer[:size]

    def ask_text(self, request: bytes) -> bytes:
        return self.ask(request, len)
