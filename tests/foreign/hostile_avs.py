"""AVs that do what no AV should, as the text of their modules."""

from __future__ import annotations

from pathlib import Path

__all__ = ["BASE", "FAULTS", "HANGS", "HARMLESS", "left_behind", "module"]

BASE = """
import ctypes, json, mmap, os, resource, signal, subprocess, sys, threading, time
import numpy as np

def brake(view):
    return np.tile([-1.0, 0.0], (len(view), 1))
def live_on():
    "A process that leaves session and parents; it says its number in the file `alive`."
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            os.environ.clear()
            with open('alive', 'a') as file:
                file.write(f'{os.getpid()} ')
            for sign in range(1, 32):
                if sign not in (9, 17, 19):
                    signal.signal(sign, signal.SIG_IGN)
            time.sleep(1000)
        os._exit(0)
    while not os.path.exists('alive'):
        time.sleep(0.01)
class Nasty:
    def __array__(self, *args, **kwargs):
        raise KeyError('no\\narray')
class Mute(Exception):
    def __str__(self):
        raise KeyboardInterrupt
deep = []
for _ in range(100_000):
    deep = [deep]
def endless(n):
    return endless(n + 1)
"""

HARMLESS = {
    "prints": "for _ in range(20_000): print('x' * 99)\nsys.__stdout__.write('y' * 300_000)",
    "writes to 1 and 2": "os.write(1, b'z' * 1_000_000); os.write(2, b'\\xff\\x00' * 500_000)",
    "prints in C": "c = ctypes.CDLL(None)\nfor _ in range(9_000): c.puts(b'w' * 99)\nc.fflush(None)",
    "prints in a thread": (
        "def go_on():\n"
        "    while True: print('still here')\n"
        "if not hasattr(self, 't'): self.t = threading.Thread(target=go_on, daemon=True); self.t.start()"
    ),
    "another stdout": "sys.stdout = sys.stderr = None",
    "another folder": "os.chdir('/')",
    "another environment": "os.environ.clear(); os.environ['PYTHONPATH'] = '/'",
    "signals": "for n in (2, 14, 15): signal.signal(n, signal.SIG_IGN)\nsignal.alarm(1)",
    "removes logs": "[os.unlink(n) for n in os.listdir('.') if n.endswith('.log')]",
    "children": "live_on()",
    "threads that wait": "threading.Thread(target=time.sleep, args=(1000,)).start()",
}
"""What costs an AV no test: what is done before the answer."""

FAULTS = {
    "junk": (
        "for n in range(3, 50):\n  try: os.write(n, os.urandom(100))\n  except OSError: pass",
        "disturbed the socket",
    ),
    "closes all": ("os.closerange(0, 256)", r"ended its process \("),
    "exit": ("sys.exit(3)", r"ended its process \(exit status 3\)"),
    "_exit": ("os._exit(0)", r"ended its process \(exit status 0\)"),
    "exit in C": ("ctypes.CDLL(None).exit(4)", r"ended its process \(exit status 4\)"),
    "kills itself": ("os.kill(os.getpid(), 9)", r"ended its process \(signal SIGKILL\)"),
    "kills its group": ("os.killpg(0, 9)", r"ended its process \(signal SIGKILL\)"),
    "kills its parent": (
        "live_on(); os.kill(os.getppid(), 9); time.sleep(9)",
        r"and the one that keeps it: signal SIGKILL\)",
    ),
    "stops its parent": (
        "live_on(); os.kill(os.getppid(), signal.SIGSTOP); os._exit(1)",
        r"closed its connection\)|gave no answer",
    ),
    "segfault": ("ctypes.string_at(0)", r"ended its process \(signal SIGSEGV\)"),
    "abort": ("os.abort()", r"ended its process \(signal SIGABRT\)"),
    "SystemExit": ("raise SystemExit('bye')", r"ended its process \(exit status 1\)"),
    "KeyboardInterrupt": ("raise KeyboardInterrupt", r"ended its process \(exit status \d\)"),
    "BaseException": ("raise BaseException('base')", r"ended its process \(exit status 1\)"),
    "alarm": ("signal.alarm(1); time.sleep(60)", r"ended its process \(signal SIGALRM\)"),
    "children and an end": ("live_on(); os._exit(0)", r"ended its process \(exit status 0\)"),
    "recursion": ("endless(0)", r"raised RecursionError\("),
    "recursion in C": (
        "sys.setrecursionlimit(10**9)\ndef deeper(): again()\nagain = ctypes.CFUNCTYPE(None)(deeper)\nagain()",
        r"ended its process \(signal SIGSEGV\)",
    ),
    "its limits": ("resource.setrlimit(resource.RLIMIT_NOFILE, (0, 0)); open('x')", r"raised OSError\("),
    "no cpu": (
        "resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass",
        r"ended its process \(signal SIG(KILL|XCPU)\)",
    ),
    "mute": ("raise Mute", r"raised Mute\(\?\)|ended its process"),
    "a name": ("raise type('a\\nb\\x1b[2J' * 999, (Exception,), {})('t\\x1b[2J\\nu' * 999)", r"raised a b\\x1b\[2J"),
    "broken array": ("return Nasty()", r"raised KeyError\('no\\narray'\)|no usable answer|raised"),
    "deep lists": ("return deep", "no usable answer|raised"),
    "text": ("return 'x' * 10**7", "no usable answer: act returned an array of type"),
    "None": ("return None", "no usable answer: act returned an array of type object"),
    "huge integers": ("return [[10**400, 0]] * len(view)", "no usable answer: act returned an array of type object"),
    "nothing": ("return np.zeros((len(view), 0))", r"no usable answer: act returned an array of shape \(4, 0\)"),
    "another shape": ("return np.zeros((10**7, 2))", r"no usable answer: act returned an array of shape"),
    "list": ("x = []\nwhile True: x.append(bytes(10**7))", r"raised MemoryError|ended its process|took more than"),
    "numpy": ("return np.ones(16 * 2**30 // 8)", r"raised _?(Array)?MemoryError|took more than"),
    "shared memory": (
        "m = mmap.mmap(-1, 3 * 2**30)\nwhile True:\n  for k in range(0, len(m), 4096): m[k] = 1",
        r"took more than 1 GB of memory \(--av-memory\)",
    ),
    "memory of children": (
        "for _ in range(4):\n  if os.fork() == 0: x = b'x' * (500 * 2**20); time.sleep(60)\ntime.sleep(60)",
        r"took more than 1 GB of memory \(--av-memory\)",
    ),
}
"""What fails a question: code, and what is said. Memory is limited to 1 GB."""

HANGS = {
    "sleeps": "time.sleep(1000)",
    "a loop": "while True: pass",
    "sleeps in C with the lock": "ctypes.PyDLL(None).sleep(1000)",
    "ignores SIGTERM": "signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(1000)",
    "prints for ever": "while True: print('x' * 1000)",
    "children": "live_on(); time.sleep(1000)",
    "stops itself": "os.kill(os.getpid(), signal.SIGSTOP)",
    "a trickle": (
        "import struct\n"
        "places = [f'/proc/self/fd/{n}' for n in range(3, 64)]\n"
        "n = next(int(p.split('/')[-1]) for p in places if os.path.exists(p) and 'socket' in os.readlink(p))\n"
        "os.write(n, struct.pack('<cQQ', b'.', 3, 1000))\n"
        "while True: os.write(n, b'x'); time.sleep(0.2)"
    ),
}


def module(code: str, where: str) -> str:
    """The source of an AV that does something in `act`, in `setup`, when it is made, or when it is imported."""
    lines = "\n".join(f"        {line}" for line in code.splitlines())
    if where == "act":
        return f"{BASE}\nclass Av:\n    def act(self, view):\n{lines}\n        return brake(view)\n"
    tail = "    def act(self, view): return brake(view)\n"
    if where == "import":
        return f"{BASE}\nclass Av:\n{tail}\ndef run(self=None, view=()):\n{lines}\nrun()\n"
    name = "setup(self, context, view=())" if where == "setup" else "__init__(self, view=())"
    return f"{BASE}\nclass Av:\n    def {name}:\n{lines}\n{tail}"


def left_behind(folder: Path) -> list[int]:
    """Processes that `live_on` of an AV made, and that are alive."""
    told = (folder / "alive").read_text().split() if (folder / "alive").exists() else []
    return [pid for pid in map(int, told) if is_alive(pid)]


def is_alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"
