"""Wrong usages of every verb: one line that says what was expected, status 2, nothing written."""

import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
import verbs
from forceaxis.cli import main

ROOT = Path(__file__).resolve().parents[3]
TUNE = (
    "tune --on sim:contact.toml --model laboratory --force 30,60 --over k_w=30% --force-max 250 "
    "--out tuned"
)

# As typed in a folder that holds contact.toml and model.toml, which are right, and bad.toml,
# empty.toml, x.csv; the words that the line must have.
WRONG = [
    ("rnu contact", "'rnu'", "'run'"),
    ("--verson", "'--version'"),
    ("run", "'EXPERIMENT'", "forceaxis run --help"),
    ("examples", "'FOLDER'", "forceaxis examples --help"),
    ("examples bad.toml", "bad.toml", "forceaxis examples --help"),
    ("run contct", "contct", "did you mean contact?"),
    ("run contcat.toml", "contcat.toml", "did you mean contact.toml?"),
    ("run contact extra", "(extra)", "forceaxis run --help"),
    ("run no/such.toml", "no/such.toml", "expected a readable file"),
    ("run .", "expected a readable file"),
    ("run bad.toml", "bad.toml: line 1", "expected valid TOML"),
    ("run empty.toml", "empty.toml: title", "add this key"),
    ("run model.toml", "model.toml", "expected an experiment, got a model"),
    ("run contact --set force_gain=7", "set.force_gain", "did you mean firmware.force_gain?"),
    ("run contact --set duration_s=2", "set.duration_s", "did you mean experiment.duration_s?"),
    ("run contact --set m_ww=7", "set.m_ww", "did you mean m_w?"),
    ("run contact --set firmware.force_gian=7", "force_gian", "did you mean force_gain?"),
    ("run contact --set firmware.force_gain", "--set", "expected NAME=VALUE"),
    ("run contact --set firmware.force_gain=", "--set", "expected NAME=VALUE"),
    ("run contact --set firmware.force_gain=seven", "force_gain", "a quantity in V/N"),
    ("run contact --set firmware.force_gain=300", "0 to 255.99609375", "got 300"),
    ("run contact --set firmware.mode=forse", "firmware.mode", "did you mean force?"),
    ('run contact --set firmware.force_setpoint="12 mm/s"', "expected a force in N"),
    ("run contact --set m_w=-1", "m_w", "> 0 in kg, got -1"),
    ("run contact --set m_w=1 --set m_w=2", "m_w", "expected one value, got 1 and 2"),
    ("run contact --set experiment.duration_s=0", "duration_s", "got 0"),
    ("run contact --set experiment.duration=1", "did you mean duration_s?"),
    ("run contact --set verdict.window=1", "verdict.window", "window_s"),
    ("run contact --out x.csv", "'--out'", "'x.csv' is a file"),
    ("run contact --link usb", "'--link'", "'lcm'"),
    ("run contact --sett m_w=1", "'--sett'", "'--set'"),
    ("recording replay", "'JOURNAL'", "forceaxis recording replay --help"),
    (
        "run sim/experiments/contact.toml",
        "contact.toml: file",
        "give the name contact alone",
    ),
    ("recording replay none.journal", "none.journal: file", "expected a readable file, got none"),
    ("recording replay x.csv", "x.csv: line 1", "expected a readable journal"),
    ("fmu plant laboratory", "'--out'", "forceaxis fmu plant --help"),
    ("fmu plant laboratory --set m_ww=3 --out u.fmu", "parameters.m_ww", "did you mean m_w?"),
    ("fmu plant no_model --out u.fmu", "expected a path ending in .toml or a name of"),
    ("fmu plant contact.toml --fmi 1.0 --out u.fmu", "'--fmi'", "'2.0', '3.0'"),
    ("fmu firmware model.toml --out u.fmu", "got a model", "use `forceaxis fmu plant`"),
    ("fmu firmware --set firmware.force_gain=3 --out u.fmu", "--set", "expected an experiment"),
    ("fmu firmware --input force_gian --out u.fmu", "--input: force_gian", "mean force_gain"),
    ("fmu firmware --input node_id --out u.fmu", "--input: node_id", "a writable object of"),
    ("fmu firmware bad.toml --out u.fmu", "bad.toml: line 1", "expected valid TOML"),
    ("sweep contact --grid m_w=1:2:3", "'--out'"),
    ("sweep contact --out maps", "expected at least one parameter to vary", "--bisect"),
    ("sweep contact --grid m_w=1:2 --out maps", "expected NAME=FROM:TO:COUNT"),
    ("sweep contact --grid m_w=1:2:1 --out maps", "expected COUNT", "2 to 1000000"),
    ("sweep contact --grid m_w=2:x:3 --out maps", "expected NAME=FROM:TO:COUNT"),
    ("sweep contact --grid m_ww=1:2:3 --out maps", "m_ww", "did you mean m_w?"),
    ("sweep contact --grid force_gain=1:2:3 --out maps", "did you mean firmware.force_gain?"),
    ("sweep contact --grid firmware.force_gian=1:2:3 --out maps", "mean firmware.force_gain or"),
    ("loop limit contact --over kw=30%", "kw=30%", "did you mean k_w"),
    ("sweep contact --random m_w=1:2 --out maps", "--count", "1 to 1000000"),
    ("sweep contact --bisect m_w=1:2:-1 --out maps", "expected TOLERANCE above 0"),
    ("sweep contact --grid m_w=1:2:3 --threads 0 --out maps", "'--threads'", "1<=x<=256"),
    ("sweep contact --grid m_w=1:2:3 --scheduler here --out maps", "tcp://HOST:PORT"),
    ("test", "'DIR|FILE...'"),
    (
        "cycle",
        "expected a command: judge, load, rates, result, run, serve, start, statistics, teach, "
        "watch",
    ),
    ("cycle run contact", "contact.toml: cycle", "names a program"),
    ("cycle run", "'EXPERIMENT'", "forceaxis cycle run --help"),
    ("cycle rates contact", "'--good'"),
    ("cycle rates contact --good x.csv", "contact.toml: cycle", "names a program"),
    ("cycle rates contact --good x.csv --propose 1%", "--propose", "-o FILE"),
    ("cycle rates contact --good x.csv --propose no -o new", "--propose: no", "such as 1%"),
    ("cycle start press_fit --parquet --on sim:press_fit", "--parquet", "add --out"),
    ("cycle start press_fit --on sim:press_fit --serial 12345678901234567", "--serial", "16 bytes"),
    ("cycle start press_fit", "expected the address of one axis, as --on"),
    ("cycle start press_fit --on sim:press_fit --out x.csv", "'--out'", "'x.csv' is a file"),
    ("cycle result press_fit", "expected the address of one axis, as --on"),
    ("cycle result press_fit --on sim:press_fit --parquet", "--parquet", "add --out"),
    ("cycle watch press_fit --on sim:press_fit", "'--out'"),
    (
        "cycle watch press_fit --on sim:press_fit --out r --master-every 8",
        "--master-every",
        "--master-serial TEXT",
    ),
    (
        "cycle watch press_fit --on sim:press_fit --out r --calibration-due soon",
        "'--calibration-due'",
        "'soon'",
    ),
    ("cycle watch press_fit --on sim:press_fit --out r --parts 0", "'--parts'", "x>=1"),
    ("cycle watch contact --on sim:contact --out r", "contact.toml: cycle", "names a program"),
    ("cycle teach press_fit r --propose 1%", "'--write'"),
    ("cycle teach press_fit r --propose 1% -o new", "r: expected a folder with records"),
    ("cycle teach press_fit r --propose all -o new", "--propose: all", "such as 1%"),
    ("cycle teach press_fit r --propose 1% -o new --parts 9", "expected the address of one axis"),
    (
        "cycle teach press_fit r --propose 1% -o new --parts 9 --on sim:press_fit",
        "--parts",
        "at least 599",
    ),
    ("cycle statistics", "'SOURCE'", "forceaxis cycle statistics --help"),
    ("cycle statistics nowhere", "nowhere", "expected a folder with records"),
    ("cycle statistics x.csv", "x.csv: expected a table of parts"),
    ("cycle statistics .", "parts.csv: expected a folder with records"),
    ("cycle statistics x.csv --last 0", "'--last'", "x>=1"),
    ("cycle statistics x.csv --plot part.gif", "--plot", ".png"),
    ("cycle statistics x.csv --page page.txt", "--page", ".html"),
    ("test nowhere", "nowhere", "expected"),
    ("test model.toml", "expected at least one experiment with a table [expect]"),
    ("report nowhere", "nowhere", "expected a folder with experiments"),
    ("report x.csv", "x.csv", "expected a folder with experiments"),
    ("report --threads many", "'--threads'", "integer"),
    ("objects forc_gain", "did you mean force_gain"),
    ("objects force --eds a.eds", "expected no pattern"),
    ("objects --eds same --dbc same", "expected a different file for each option"),
    ("objects --eds no/such/folder.eds", "no folder no/such"),
    ("loop limit", "'MODEL|EXPERIMENT'"),
    ("loop limit fig4_20", "fig4_20", "sim/models", "did you mean fig4_"),
    ("loop limit contact --law pdd", "--law: pdd: expected one of the laws", "did you mean pd"),
    ("loop limit fig4_19 --law lead", "--law zero: expected a value"),
    ("loop limit fig4_19 --law gain=much", "one number in V/N for gain, got much"),
    ("loop limit fig4_19 --law pi:ki=4", "integral (rad/s)", "got ki=4"),
    ("loop limit fig4_19 --law pi:", "integral (rad/s)", "got nothing"),
    ("loop limit fig4_19 --law pi:integral=1,integral=2", "for integral, got a second one"),
    ("loop limit fig4_19 --gain=4 --law pi", "`forceaxis loop limit fig4_19 --law pi:gain=4`"),
    ("loop advise fig4_19 --gain 4", "No such option"),
    ("design laboratory --over k_w=30% --ms-late 2", "--ms-late: expected design without", "1.1"),
    ("loop compliance laboratory --adc-bits=12", "--adc-bits: expected", "give a model"),
    ("identify fit model.toml x.csv --scale 2", "--scale: expected", "multiply the column"),
    ("cycle statistics records --curves 5", "--curves: expected", "the last 20 curves"),
    ("monitor --codes", "--codes: expected", "the key u"),
    ("bench --linear", "--linear: expected", "--check measures"),
    ("loop poles strike_biquad --law pi:integral=4", "--law gain or --law force_gain together"),
    ("loop limit fig4_19 --law gain=1,force_gain=2", "either --law gain or --law force_gain"),
    ("loop limit fig4_19 --timing both --over k_q=30%", "k_q", "expected"),
    ("loop limit fig4_19 --over k_w=30", "k_w=30", "expected"),
    ("loop limit fig4_19 --mode sensor=open", "apart, pressed"),
    ("loop limit x.csv", "expected a path ending in .toml"),
    ("design laboratry", "did you mean laboratory"),
    ("design laboratory --over nothing", "nothing", "expected"),
    ("design laboratory --pareto cost", "bandwidth and one of"),
    ("loop advise laboratory --simulate --linear", "expected either --simulate or --linear"),
    ("loop advise laboratory --factor 0", "expected a number above 1"),
    ("loop advise laboratory --out advice.docx", "expected a file ending in .png"),
    ("loop compliance laboratory --from 1e5", "expected both --from and --to"),
    ("loop compliance laboratory --points 1", "2<=x<=40"),
    ("loop compliance laboratory --element m_w", "one of k_rf, k_s, k_w"),
    ("loop step fig4_19 --law force_gain=5 --duration-s 0", "--duration-s", "two ticks to 600 s"),
    ("loop step fig4_19 --law force_gain=5 --out step.xyz", "expected a file ending in .png"),
    ("loop nyquist fig4_19 --output tip.speed", "expected one of", "robot.position"),
    ("loop nyquist fig4_19 --out no/such/folder.png", "no/such/folder.png"),
    ("loop rlocus fig4_19 --span-hz 0", "'--span-hz'", "1e-06 to 1e+06"),
    ("loop rlocus fig4_19 --vary b_w", "expected NAME=NUMBER,NUMBER"),
    ("loop bode fig4_19 --from-hz 10 --to-hz 1", "expected FROM < TO"),
    ("loop bode fig4_19 --of everything", "'--of'", "'sensitivity'"),
    ("loop bode fig4_19 --input robot.speed", "expected one of drive.command"),
    ("loop poles fig4_19 --input motor", "expected one of drive.command"),
    ("loop modes fig4_19 --output", "'--output'", "--help` shows"),
    ("loop modes nothing", "expected a path ending in .toml or a name of", "sim/models"),
    ("loop linearise fig4_19 --out plant.doc", "expected a file ending in .npz or .mat"),
    ("loop linearise contact.toml", "expected a model, got an experiment"),
    ("thesis beam --modes 0", "'--modes'", "1<=x<=200"),
    ("measure fig3_12 --band 5", "expected two frequencies in Hz as LOW:HIGH"),
    ("measure fig3_12 --averages 0", "averages", "4..4096"),
    ("measure", "expected the address of one axis, as --on"),
    ("measure --on sim:contact.toml", "expected --free"),
    ("identify", "expected a command: contact, decrement, fit"),
    ("identify contact laboratory", "'RECORDING...'", "forceaxis identify contact --help"),
    ("identify contact laboratory no.npz --fit k_w", "no.npz: expected a readable file"),
    ("identify contact laboratory x.csv --fit k_w", "x.csv: expected a recording"),
    ("loop limit contact --over no.json", "no.json: expected a posterior.json"),
    ("sweep contact --over no.json --out swept", "--count: expected a number of points"),
    ("sweep contact --over no.json --count 5 --out swept", "no.json: expected a posterior.json"),
    ("identify decrement none.csv", "none.csv: expected a file, but there is no such file"),
    ("identify decrement x.csv --mass 1 --stiffness 2", "expected either --mass or --stiffness"),
    ("identify split --total-mass 10", "'--stiffness'"),
    ("identify split --total-mass 9 --stiffness 9 --frequency-hz fast", "VALUE+-ERROR"),
    (
        "identify tach x.csv --speed nowhere",
        "column with the name nowhere in the first line, got the columns a, b",
    ),
    ("identify motor x.csv", "'--k-torque'"),
    ("identify fit fig4_19 x.csv --fit m_r", "--output", "does not contain it"),
    ("identify resonances fig4_11 nowhere --rigid robot.acceleration", "nowhere", "expected"),
    ("axis", "expected a command:", "params"),
    ("axis gte --on lcm:1", "'gte'", "'get'"),
    ("axis get --on lcm:1", "'NAME...'"),
    ("axis get force", "address of one axis", "--on ADDRESS", "FORCEAXIS_AXIS"),
    ("axis get --on lcm:1 --on can0 force", "address of one axis", "got 2"),
    ("axis get --on lcm:128 force", "--on: lcm:128", "expected an axis number from 1 to 127"),
    ("axis get --on sim:contact.toml forse", "`forceaxis objects`", "did you mean force"),
    ("axis get --on sim:nowhere.toml force", "nowhere.toml", "expected a readable file"),
    ("axis get --on udp://here force", "expected the address of an axis", "tcp://"),
    ("axis get --on nocan0 force", "--on: nocan0", "expected a CAN interface"),
    ("axis set --on sim:contact.toml force_gain", "expected NAME=VALUE"),
    ("axis set --on sim:contact.toml force_gain=300", "expected 0 to 255.996", "got 300"),
    ("axis set --on sim:contact.toml store_parameters=2", "expected 1, got 2"),
    ("axis set --on sim:contact.toml force=3", "expected an object that can be written"),
    ("axis move --on sim:contact.toml far", "POSITION", 'a quantity such as "10 mm"'),
    ("axis press --on sim:contact.toml 20 --retract far", "--retract", 'as "5 mm"'),
    ("axis press --on sim:contact.toml", "'FORCE'"),
    ('axis press --on sim:contact.toml "75 mm"', 'expected a force such as "75 N"'),
    ("axis press --on sim:contact.toml 20 --seconds -1", "'--seconds'", "0.1 to 3600"),
    ("axis enable --on sim:contact.toml flying", "expected a mode of operation", "homing"),
    (
        "axis capture --on sim:contact.toml nothing --out cap",
        "nothing",
        "expected the name of an object",
    ),
    (
        "axis capture --on sim:contact.toml force --trigger soon --out cap",
        "--trigger: soon",
        "rising",
    ),
    ("axis calibrate --on sim:contact.toml --point 1", "expected COUNT,N"),
    ("axis params load x.csv --on sim:contact.toml", "x.csv: line 1", "expected valid TOML"),
    ("axis params diff --on sim:contact.toml", "'FILE'"),
    ("axis params", "expected a command:", "dump"),
    ("axis list --on nocan0", "--on: nocan0", "expected a CAN interface"),
    ("axis stop", "expected the address of one axis, as --on"),
    ("axis check", "expected the address of one axis, as --on"),
    ("axis tare --on lcm@udpm://here", "an address with the number of an axis", "lcm:2"),
    ("tune --on sim:contact.toml", "'--model'"),
    (f"{TUNE} --only everything", "--only", "expected one of check"),
    (f"{TUNE} --prior m_x=2", "--prior: m_x=2: expected NAME=VALUE or", "m_w"),
    (f"{TUNE} --prior m_w", "--prior: m_w: expected NAME=VALUE or NAME=VALUE+-PERCENT%"),
    (f"{TUNE} --prior m_w=-2+-5%", "--prior: m_w=-2+-5%: expected", "above 0"),
    (f"{TUNE} --prior m_w=2+-0%", "--prior: m_w=2+-0%: expected", "above 0"),
    (f"{TUNE} --over m_x=30%", "m_x", "expected"),
    (f"{TUNE} --prior", "'--prior'", "requires an argument"),
    ("axis incident", "expected the address of one axis, as --on"),
    ("axis incident --on lcm:1 --wait never", "'--wait'", "expected a number"),
    ("monitor --json", "--json", "--once"),
    (
        "monitor --replay x.csv --on lcm@udpm://239.255.76.67:7700",
        "--replay",
        "expected neither --record nor lcm@URL",
    ),
    ("monitor --speed 2", "--speed", "--replay"),
    ("monitor --replay none.log --once", "none.log", "expected an LCM log"),
    ("recording", "expected a command: convert, export, import"),
    ("recording info none.csv", "none.csv: expected an LCM log that can be read"),
    ("recording import x.csv --out r", "'--map'"),
    ("recording import x.csv --map force=a:N", "'--out'"),
    ("recording import x.csv --map force=c:N --out r", "--map", "expected a column", "got c"),
    ("recording import x.csv --map force=a:N --out r", "x.csv", "expected a column of times"),
    ("recording import none.csv --map force=a:N --out r", "none.csv", "expected a file"),
    ("compare contact", "'RECORDING...'"),
    ("compare contact x.csv", "x.csv", "expected a recording that"),
    ("compare contact x.csv --samples 2", "--samples", "expected 8 to 2000"),
    ("compare contact x.csv --span 0", "--span", "expected at least 0.02 s"),
    ("compare contct x.csv", "contct", "did you mean contact?"),
    ("recording info none.log", "none.log", "expected an LCM log"),
    ("recording export x.csv", "'--out'"),
    ("recording convert x.csv y.csv", "y.csv", ".mcap or .log"),
    ("recording convert x.csv y.mcap", "x.csv", "expected an LCM log"),
    ("run contact --record trace.csv", "--record", ".mcap or .log"),
    ("cycle serve nothing", "nothing", "expected a folder with records"),
    ("monitor --foxglove --once", "--foxglove", "--once"),
    ("recording export x.csv --out tables", "x.csv", "expected an LCM log"),
    ("flash", "'FILE'"),
    ("flash x.csv", "x.csv", "expected a file ending in .elf, .hex or .bin"),
    ("flash x.csv --address 99999999999", "'--address'", "32 bits"),
    ("flash x.csv --on can0", "x.csv", "expected an update file"),
    ("flash x.csv --on lcm:1", "--on: lcm:1", "over CAN or Modbus"),
    ("flash x.csv --on can0 --serial 7", "--serial", "only a debug probe uses these"),
    ("flash x.csv --new-table", "--new-table", "expected --on ADDRESS"),
    ("axis bringup --on sim:contact", "expected a terminal"),
    ("axis bringup", "expected the address of one axis, as --on"),
    ("axis bringup --on sim:contact --step all", "'--step'"),
    ("thesis tables --fit --link lcm", "expected --fit without --link"),
    ("thesis check now", "(now)", "forceaxis thesis check --help"),
    ("thesis session --out x.csv", "'--out'", "is a file"),
    ("bench --case C", "'--case'", "'full'"),
    ("bench --check --case A", "expected --check without"),
    ("new", "'NAME'"),
    ("new press --moving-mass-kg heavy --yes", "expected a plain number", "'heavy'"),
    ("new press --moving-mass-kg -3 --yes", "0.001 to 1e+06 kg"),
    ("new press --colour red", "'--colour'"),
    ("new x.csv --yes", "'x.csv' is a file"),
    ("completion", "expected a command: install, show"),
    ("completion install tcsh", "'tcsh'", "'zsh'"),
]


def snapshot(folder):
    return {p: p.read_bytes() if p.is_file() else None for p in folder.rglob("*")}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wrong")
    text = (ROOT / "sim/experiments/contact.toml").read_text()
    (folder / "contact.toml").write_text(text.replace("../models", str(ROOT / "sim/models")))
    text = (ROOT / "sim/models/fig4_19.toml").read_text()
    (folder / "model.toml").write_text(
        text.replace("thesis.toml", f"{ROOT}/sim/models/thesis.toml")
    )
    (folder / "bad.toml").write_text("title = \n")
    (folder / "empty.toml").write_text("")
    (folder / "x.csv").write_text("a,b\n1,2\n")
    return folder


@pytest.mark.parametrize(("line", "words"), [(w[0], w[1:]) for w in WRONG], ids=lambda v: str(v))
def test_a_wrong_usage_is_one_line_and_writes_nothing(folder, line, words):
    before = snapshot(folder)
    typed = shlex.split(line)
    done = verbs.forceaxis(*typed, cwd=folder)
    assert (done.returncode, done.stdout) == (2, ""), done.stderr
    assert done.stderr.startswith("forceaxis: ") and done.stderr.count("\n") == 1
    assert all(word in done.stderr for word in words), done.stderr
    assert snapshot(folder) == before


def test_there_are_a_hundred_over_all_verbs():
    assert len({w[0] for w in WRONG}) >= 100
    typed = {shlex.split(w[0])[0] for w in WRONG}
    assert {*main.WORDS} - {"gateway"} <= typed
    context = click.Context(main.cli)
    for group in ("loop", "thesis"):
        names = main.cli.get_command(context, group).commands
        assert names.keys() <= {shlex.split(w[0])[1] for w in WRONG if w[0].startswith(group)}


def test_a_wrong_usage_of_a_program_of_the_build(tmp_path):
    """`forceaxis gateway` becomes the gateway, so this needs a process of its own."""
    words = [Path(sys.executable).parent / "forceaxis", "gateway", "--cann", "vcan0"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert "--cann" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_folder_of_those_usages_is_a_good_one(folder):
    """None of them is refused for another reason than the one that it is there for."""
    short = ["--set", "experiment.duration_s=0.1", "--set", "verdict.window_s=0.1"]
    assert verbs.forceaxis("run", "contact.toml", *short, cwd=folder).returncode == 0
    assert verbs.forceaxis("loop", "modes", "model.toml", cwd=folder).returncode == 0
