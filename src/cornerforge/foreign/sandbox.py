"""Walls around an AV's process, of what Linux offers every user: namespaces, and mounts that only it sees.

Behind them there is no network, nothing can be written but a scratch that is gone with the process, no process outside
can be seen or ended, and no right can be gained. Needs the standard library only.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import socket
import struct
import sys
from contextlib import suppress

__all__ = ["HIDDEN", "SCRATCH", "is_hidden", "part", "wall_in"]

HIDDEN = ("/tmp", "/var/tmp", "/run")
"""Folders in whose place the AV sees an empty one of its own: sockets of other programs lie there."""
SCRATCH = "/dev/shm"
"""Folder for temporary files, also where the AV's own files lie in one of `HIDDEN`."""
_SCRATCH_BYTES = 1 << 30
_DEVICES = ("null", "zero", "full", "random", "urandom", "tty")
_GPU = ("nvidia", "dri", "kfd")
_NEW_MOUNTS, _NEW_IPC, _NEW_USER, _NEW_PIDS, _NEW_NET = 0x20000, 0x8000000, 0x10000000, 0x20000000, 0x40000000
_READ_ONLY, _NO_SETUID, _NO_DEVICES, _NO_EXECUTION, _BIND, _RECURSIVE, _PRIVATE = 1, 2, 4, 8, 4096, 16384, 1 << 18
_MOUNT_SETATTR, _HERE, _AT_RECURSIVE = 442, -100, 0x8000
_DROP_FROM_BOUNDS, _NO_NEW_RIGHTS, _AMBIENT, _CLEAR_ALL = 24, 38, 47, 4
_CAPABILITIES_VERSION = 0x20080522
_FLAGS_OF_INTERFACE, _SET_FLAGS_OF_INTERFACE, _UP = 0x8913, 0x8914, 1
_libc = ctypes.CDLL(None, use_errno=True)


def _checked(what: str, result: int) -> None:
    if result == -1:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def part() -> None:
    """Give this process, which has one thread, its own users and network; its next child is the first of its own pids.

    Raises:
        OSError: The system does not allow it.
    """
    if sys.platform != "linux":
        raise OSError(0, f"{sys.platform} has no namespaces")
    user, group = os.getuid(), os.getgid()
    _checked("new namespaces", _libc.unshare(_NEW_USER | _NEW_PIDS | _NEW_NET | _NEW_IPC))
    for name, text in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
        _write(f"/proc/self/{name}", text)


def wall_in(visible: list[str]) -> None:
    """Take all but reading away from this process and its children to come; it is the first of its pids.

    Args:
        visible: Folders below `HIDDEN` that can be seen all the same.

    Raises:
        OSError: The system does not allow it.
    """
    here = os.getcwd()
    _checked("own mounts", _libc.unshare(_NEW_MOUNTS))
    _mount(None, "/", None, _RECURSIVE | _PRIVATE)
    with suppress(OSError):
        _write("/proc/sys/user/max_user_namespaces", "0")
    _set_attributes("/", _READ_ONLY | _NO_SETUID | _NO_DEVICES, recursive=True)
    kept = [
        (os.open(folder, os.O_PATH), folder)
        for folder in sorted({os.path.realpath(one) for one in [here, *visible]})
        if is_hidden(folder) and os.path.isdir(folder)
    ]
    _make_devices()
    for folder in (*HIDDEN, SCRATCH):
        if os.path.isdir(folder) and not os.path.islink(folder):
            _mount("tmpfs", folder, "tmpfs", _NO_SETUID | _NO_DEVICES, f"mode=1777,size={_SCRATCH_BYTES}")
    for fd, folder in kept:
        os.makedirs(folder, exist_ok=True)
        _mount(f"/proc/self/fd/{fd}", folder, None, _BIND | _RECURSIVE)
        os.close(fd)
    _mount("proc", "/proc", "proc", _READ_ONLY | _NO_SETUID | _NO_DEVICES | _NO_EXECUTION)
    os.chdir(here)
    _raise_loopback()
    _give_up_rights()


def is_hidden(folder: str) -> bool:
    """Does a folder lie in one of `HIDDEN`, or is it one?"""
    return any(f"{folder}/".startswith(f"{hidden}/") for hidden in HIDDEN)


def _write(path: str, text: str) -> None:
    with open(path, "w", encoding="ascii") as file:
        file.write(text)


def _mount(source: str | None, target: str, kind: str | None, flags: int, data: str | None = None) -> None:
    names = [None if name is None else os.fsencode(name) for name in (source, target, kind)]
    told = None if data is None else data.encode()
    _checked(f"mount at {target}", _libc.mount(*names, ctypes.c_ulong(flags), told))


def _set_attributes(target: str, given: int, taken: int = 0, *, recursive: bool = False) -> None:
    about = struct.pack("=QQQQ", given, taken, 0, 0)
    flags = _AT_RECURSIVE if recursive else 0
    _checked(
        f"attributes of the mount {target}",
        _libc.syscall(_MOUNT_SETATTR, _HERE, os.fsencode(target), flags, about, ctypes.c_size_t(len(about))),
    )


def _make_devices() -> None:
    """Make a /dev of a few harmless devices, and of those of GPUs."""
    names = [name for name in sorted(os.listdir("/dev")) if name in _DEVICES or name.startswith(_GPU)]
    opened = [(os.open(f"/dev/{name}", os.O_PATH), name, os.path.isdir(f"/dev/{name}")) for name in names]
    _mount("tmpfs", "/dev", "tmpfs", _NO_SETUID, "mode=755,size=65536")
    for fd, name, is_folder in opened:
        place = f"/dev/{name}"
        if is_folder:
            os.mkdir(place)
        else:
            os.close(os.open(place, os.O_CREAT | os.O_WRONLY))
        _mount(f"/proc/self/fd/{fd}", place, None, _BIND | _RECURSIVE)
        _set_attributes(place, 0, _NO_DEVICES)
        os.close(fd)
    for name, target in (("fd", "fd"), ("stdin", "fd/0"), ("stdout", "fd/1"), ("stderr", "fd/2")):
        os.symlink(f"/proc/self/{target}", f"/dev/{name}")
    os.mkdir(SCRATCH)
    _set_attributes("/dev", _READ_ONLY)


def _raise_loopback() -> None:
    """Let the AV's own processes talk with each other over 127.0.0.1; nobody else is there."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        name = b"lo".ljust(16, b"\0")
        answer = fcntl.ioctl(any_socket, _FLAGS_OF_INTERFACE, name + bytes(24))
        (flags,) = struct.unpack_from("=H", answer, 16)
        fcntl.ioctl(any_socket, _SET_FLAGS_OF_INTERFACE, name + struct.pack("=H", flags | _UP) + bytes(22))


def _give_up_rights() -> None:
    """Give up the rights over the new namespaces, for good: a mount could be made writable again."""
    zero = [ctypes.c_ulong(0)] * 3
    _checked("no new rights", _libc.prctl(_NO_NEW_RIGHTS, ctypes.c_ulong(1), *zero))
    capability = 0
    while _libc.prctl(_DROP_FROM_BOUNDS, ctypes.c_ulong(capability), *zero) == 0:
        capability += 1
    _libc.prctl(_AMBIENT, ctypes.c_ulong(_CLEAR_ALL), *zero)
    head = struct.pack("=Ii", _CAPABILITIES_VERSION, 0)
    _checked("no capabilities", _libc.capset(head, bytes(24)))


def _try() -> None:
    """Make walls around nothing; print why that fails, if it does."""
    try:
        part()
        if child := os.fork():
            os.waitpid(child, 0)
            return
        wall_in([])
    except OSError as error:
        print(error.strerror)


if __name__ == "__main__":
    _try()
