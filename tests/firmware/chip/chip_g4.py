"""The released image for the STM32G474 in an emulated Cortex-M4, in front of models of its
peripherals. QEMU has no such chip."""

from typing import ClassVar

import chip
import peripherals_g4
from forceaxis.chip import board

BOARD = board.read(chip.ROOT / "firmware/port/stm32g4")
IMAGE = chip.ROOT / f"build/image/{BOARD.image}.elf"
FDCAN1, FDCAN2, FDCAN2_SENT = 21, 86, 87


class Chip(chip.Chip):
    """A chip out of reset."""

    models: ClassVar = peripherals_g4.Board
    images: ClassVar = (IMAGE,)
    slots_of_board: ClassVar = ()
    store: ClassVar = (0x08040000, 0x10000)
    uid, reference = 0x1FFF7590, (0x1FFF75AA, 1655)  # VREFINT_CAL: 1.212 V at 3.0 V
    buses: ClassVar = (
        (0x40000000, 0x30000), (0x48000000, 0x1000), (0x50000000, 0x1000),
        (0xE000E000, 0x1000), (0xE0042000, 0x1000),
    )  # fmt: skip
    vector_count = 104

    def requested(self):
        board = self.board
        requests = (
            (chip.PVD, lambda: board.exti.interrupt(16)),
            (chip.INDEX, lambda: board.exti.interrupt(3)),
            (FDCAN1, board.can.interrupt),
            (chip.USART2, board.usart.interrupt),
            (FDCAN2, board.can2.interrupt),
            (FDCAN2_SENT, lambda: board.nvic.take(FDCAN2_SENT) or board.can2.sent_interrupt()),
        )
        return self.first(requests)
