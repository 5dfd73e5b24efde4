"""tools/check_svd, against SVD files written from registers.h itself: each kind of difference is
found. The vendor's files are not part of the project."""

import importlib.machinery
import importlib.util
import re
import subprocess
import sys

import pytest
from chip import BOARD, ROOT

LOADER = importlib.machinery.SourceFileLoader("check_svd", str(ROOT / "tools/check_svd"))
SPEC = importlib.util.spec_from_loader("check_svd", LOADER)
CHECK = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(CHECK)
NAMES = BOARD.registers


def svd_of_header():
    peripherals, fields, irqs = CHECK.read_header(CHECK.header_text(BOARD))
    lines = ["<device><peripherals>"]
    for name, (base, registers) in peripherals.items():
        if name in NAMES.core:
            continue
        lines.append(f"<peripheral><name>{NAMES.peripherals.get(name, name)}</name>")
        lines.append(f"<baseAddress>{base:#x}</baseAddress><registers>")
        for register, offset in registers.items():
            lines.append(f"<register><name>{register}</name><addressOffset>{offset:#x}")
            lines.append("</addressOffset><fields>")
            for at, width, rest in sorted(
                {
                    (at, width, CHECK.owner(macro, peripherals, NAMES)[2].split("_")[0])
                    for macro, at, width in fields
                    if CHECK.owner(macro, peripherals, NAMES)[:2] == (name, register)
                }
            ):
                lines.append(f"<field><name>{rest}</name><bitOffset>{at}</bitOffset>")
                lines.append(f"<bitWidth>{width}</bitWidth></field>")
            lines.append("</fields></register>")
        lines.append("</registers>")
        lines += [
            f"<interrupt><name>{n}</name><value>{v}</value></interrupt>"
            for n, v in irqs.items()
            if n.startswith(name)
        ]
        lines.append("</peripheral>")
    return "".join(lines) + "</peripherals></device>"


CHANGES = {
    "nothing": ("", "", None),
    "base": ("<baseAddress>0x40007400", "<baseAddress>0x40007800", "DAC: base"),
    "offset": (
        "<name>TSR</name><addressOffset>0x8<",
        "<name>TSR</name><addressOffset>0x9<",
        "CAN1_TSR: offset",
    ),
    "bit": (
        "<name>BSY</name><bitOffset>16<",
        "<name>BSY</name><bitOffset>17<",
        "FLASH_SR_BSY: bits",
    ),
    "width": (
        "<name>PLLN</name><bitOffset>6</bitOffset><bitWidth>9<",
        "<name>PLLN</name><bitOffset>6</bitOffset><bitWidth>8<",
        "RCC_PLLCFGR_PLLN_168: bits",
    ),
    "name": ("<name>SWSTART<", "<name>START<", "ADC_CR2_SWSTART: bits"),
    "lacking": ("<name>RDERR<", "<name>OTHER<", "FLASH_SR_RDERR: bits"),
    "interrupt": ("<value>38<", "<value>39<", "IRQ_USART2: 38, in the SVD 39"),
    "peripheral": ("<name>IWDG<", "<name>WWDG<", "IWDG: the SVD has no such peripheral"),
}


@pytest.mark.parametrize("name", CHANGES)
def test_a_difference_is_found(name, tmp_path):
    old, new, message = CHANGES[name]
    text = svd_of_header()
    assert old in text
    for device in NAMES.devices:
        (tmp_path / f"{device}.svd").write_text(text.replace(old, new, 1))
    done = subprocess.run(
        [sys.executable, ROOT / "tools/check_svd", "--board", BOARD.folder, tmp_path],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == (0 if message is None else 1), done.stdout + done.stderr
    if message is not None:
        assert f"STM32F446x: {message}" in done.stdout


def crate_of_header(described, folder):
    """The source of a crate as svd2rust writes it: one block of registers for each peripheral."""
    names = described.registers
    peripherals, fields, irqs = CHECK.read_header(CHECK.header_text(described))
    text = "pub enum Interrupt {\n"
    text += "".join(f"    {name} = {value},\n" for name, value in irqs.items()) + "\n}\n"
    for name, (base, registers) in peripherals.items():
        block = name.lower()
        text += f"pub struct {name} {{\n    _marker: X,\n}}\nimpl {name} {{ pub const PTR: "
        text += f"*const {block}::RegisterBlock = {base:#x} as *const _;\n}}\n"
        (folder / block).mkdir(parents=True)
        rows = ""
        for register, offset in registers.items():
            rows += f'#[doc = "{offset:#x} - one"]\n    pub {register.lower()}: crate::Reg<X>,\n'
            own = [
                (at, width, CHECK.owner(macro, peripherals, names)[2].split("_")[0])
                for macro, at, width in fields
                if CHECK.owner(macro, peripherals, names)[:2] == (name, register)
            ]
            (folder / block / f"{register.lower()}.rs").write_text(
                "".join(
                    f'#[doc = "Bits {at}:{at + width - 1} - one"]\n    #[inline(always)]\n'
                    f"    pub fn {re.sub('^n(?=[A-Z])', 'n_', field).lower()}(&self) -> X {{}}\n"
                    for at, width, field in own
                )
            )
        (folder / f"{block}.rs").write_text(rows)
    (folder / "mod.rs").write_text(text)


CRATE_CHANGES = {
    "nothing": ("mod.rs", "", "", None),
    "base": ("mod.rs", "0x40006400", "0x40006c00", "FDCAN1: base"),
    "interrupt": ("mod.rs", "TIM4 = 30", "TIM4 = 31", "IRQ_TIM4: 30, in the SVD 31"),
    "offset": ("fdcan1.rs", '"0x44 - one', '"0x48 - one', "FDCAN1_PSR: offset"),
    "bit": ("fdcan1/psr.rs", "Bits 7:7", "Bits 8:8", "FDCAN_PSR_BO: bits"),
}


@pytest.mark.parametrize("name", CRATE_CHANGES)
def test_a_difference_from_a_crate_is_found(name, tmp_path):
    file, old, new, message = CRATE_CHANGES[name]
    folder = ROOT / "firmware/port/stm32g4"
    described = CHECK.boards.read(folder)
    crate_of_header(described, tmp_path / "stm32g474")
    path = tmp_path / "stm32g474" / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    done = subprocess.run(
        [sys.executable, ROOT / "tools/check_svd", "--board", folder, tmp_path],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == (0 if message is None else 1), done.stdout + done.stderr
    if message is not None:
        assert f"stm32g474: {message}" in done.stdout


def test_files_that_are_missing_are_refused_in_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, ROOT / "tools/check_svd", "--board", BOARD.folder, tmp_path],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2 and done.stderr.count("\n") == 1
