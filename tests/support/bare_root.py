"""A root directory with few packages of Debian, copied from this machine, and commands in it."""

import os
import re
import subprocess
from pathlib import Path

LEFT_OUT = ("/usr/share/doc/", "/usr/share/man/", "/usr/share/locale/")
# Mounts what a process needs, makes a network of its own with multicast, changes to the root.
ENTER = """
mount --bind /dev "$0/dev" && mount -t proc proc "$0/proc" &&
ip link set lo up && ip route add 224.0.0.0/4 dev lo &&
exec chroot "$0" /bin/bash -e -c "$1"
"""


def closure(wanted):
    """The installed packages that are essential, or that the wanted ones depend on."""
    form = "${Package}\\t${Essential}\\t${Depends}, ${Pre-Depends}\\t${Provides}\\n"
    table = subprocess.run(["dpkg-query", "-W", f"-f={form}"], capture_output=True, text=True)
    needs, providers, essential = {}, {}, set()
    for row in table.stdout.splitlines():
        name, is_essential, depends, provides = row.split("\t")
        needs[name] = [
            [re.split(r"[ :(]", choice.strip())[0] for choice in group.split("|")]
            for group in depends.split(",")
            if group.strip()
        ]
        essential |= {name} if is_essential == "yes" else set()
        for other in [name, *(re.split(r"[ :(]", p.strip())[0] for p in provides.split(","))]:
            providers.setdefault(other, name)
    found, todo = set(), [*wanted, *sorted(essential)]
    while todo:
        name = todo.pop()
        if name not in found:
            found.add(name)
            for choices in needs[name]:
                todo.append(next(providers[c] for c in choices if c in providers))
    return sorted(found)


def make(root, wanted):
    """Fills an empty folder with the files of packages. Returns the names of all packages."""
    packages = closure(wanted)
    listed = subprocess.run(["dpkg", "-L", *packages], capture_output=True, text=True, check=True)
    # A file of /bin is named where it is, below /usr/bin; /bin itself is a link.
    names = sorted(
        os.path.join(os.path.realpath(os.path.dirname(name)), os.path.basename(name))
        for name in listed.stdout.splitlines()
        if name.startswith("/") and name != "/." and os.path.lexists(name)
    )
    names = [name for name in dict.fromkeys(names) if not name.startswith(LEFT_OUT)]
    files = "\0".join(name.removeprefix("/") for name in names)
    pack = ["tar", "-C", "/", "--no-recursion", "--null", "-T", "-", "-cf", "-"]
    packed = subprocess.run(pack, input=files.encode(), capture_output=True, check=True)
    subprocess.run(["tar", "-C", root, "-xf", "-"], input=packed.stdout, check=True)
    for name in ("dev", "proc", "tmp", "root", "etc"):
        (Path(root) / name).mkdir(exist_ok=True)
    subprocess.run(["ldconfig", "-r", root], check=True)
    return packages


def enter(root, script, seconds=600):
    """Runs a script of bash in the root, which has no network but its own. Returns what subprocess
    returns."""
    user = [] if os.getuid() == 0 else ["--map-root-user"]
    return subprocess.run(
        ["unshare", *user, "--mount", "--net", "--pid", "--fork", "sh", "-c", ENTER, root, script],
        env={"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        timeout=seconds,
    )
