"""A worker that misbehaves: in the way WAY, from the time on that workers with this LOG are asked for STEP the ATth time. `start` is
before a worker is asked for anything.

hostile_worker.py LOG STEP WAY AT SEED
"""

import json
import os
import random
import re
import signal
import subprocess
import sys
import time

LOG, STEP, WAY, AT, SEED = sys.argv[1:]
PARTS = ["exact", "checks", "time"] + ["instructions"] * (STEP == "instructions")
ADAPTER = {
    "name": "toy", "backend": "toy", "device_type": "Cpu", "driver": "toy", "driver_info": "", "vendor_id": 0, "device_id": 0,
    "software": STEP != "clock", "timestamp_period_ns": 1.0, "host_threads": 1,
}
PLAN = {"compute": "timestamp", "render": "timestamp", "copy": "timestamp"}
WORK = {"name": "a", "work": {"photons": 7}, "counters": {"fragments": 3}}
CHECK = {"stage": "a", "what": "energy", "unit": "%", "measured": 0.5, "tolerance": 1.0, "sound": True}
# Escape sequences, a line break and a bell, 720 kB as JSON.
LONG = "\x1b[31mred\n\x07" * 30_000


def usual(request):
    match request["message"]:
        case "hello":
            return {"protocol": 1, "fathom_version": "0", "adapter": ADAPTER, "parts": PARTS, "notes": ["a note"]}
        case "clock":
            cost = {"compute_ns": 1.0, "render_ns": 1.0, "copy_ns": 1.0}
            return {"clock": PLAN | {"submit_cost": cost}}
        case "prepare":
            return {"stages": [{"name": name, "kind": "compute"} for name in "ab"]}
        case "exact":
            stages = [WORK | {"name": name} for name in "ab"]
            return {"stages": stages, "allocated_bytes": 8, "errors": {"e": 0.5}, "quantities": {"q": 1.5}, "notes": []}
        case "checks":
            # One stage at a time: each has its own time.
            [stage] = request["stages"]
            return {"checks": [CHECK | {"stage": stage}]}
        case "sample":
            # Less than any request takes.
            return {"ns": [200.0] * request["frames"]}
        case "instructions":
            return {"frames": request["frames"]}


def put(data):
    while data:
        data = data[os.write(1, data) :]


def say(message):
    put(json.dumps(message).encode() + b"\n")


def linger():
    while True:
        time.sleep(3600)


def forever(data):
    while True:
        put(data)


def number(text):
    """The reply with each of its numbers replaced."""
    return lambda reply: put(re.sub(r"(?<=[:\[ ])\d[\d.]*", text, json.dumps(reply)).encode() + b"\n")


def lists(change):
    return lambda reply: say({key: change(value) if isinstance(value, list) else value for key, value in reply.items()})


def named(value):
    """Each list and each object with members of immense names."""
    match value:
        case [dict(first), *_]:
            return [*value, first | {key: LONG for key in first if isinstance(first[key], str)}]
        case [str(), *_]:
            return [*value, LONG]
        case dict() if all(isinstance(inner, float) for inner in value.values()):
            return value | {LONG: 1.0}
    return value


def another(message):
    """A sound reply to what was not asked."""
    kind = "prepare" if message == "hello" else "hello"
    return {"message": "prepared" if kind == "prepare" else kind} | usual({"message": kind})


def garbled(reply):
    """The reply with some of its bytes changed, left out, or there many times."""
    dice = random.Random(int(SEED))
    data = bytearray(json.dumps(reply).encode() + b"\n")
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(data))
        end = at + dice.randint(1, 8)
        data[at:end] = dice.choice([b"", bytes([dice.randrange(256)]), data[at:end] * 1000, b"-", b"null", b"1e999", b"\n"])
    put(data + b"\n")


def orphan(reply):
    """Ends; what it leaves behind holds its output open."""
    child = subprocess.Popen(["sleep", "3600"], start_new_session=True)
    note(child.pid)
    sys.exit(0)


def mute(reply):
    os.close(1)
    linger()


def die(reply):
    os.kill(os.getpid(), signal.SIGKILL)


FAULT = {"message": "fault", "reason": LONG, "absent": False}
WAYS = {
    "usual": say,
    "rubbish": lambda reply: put(b"\x00\x1b[31mfish\x07\n"),
    "bytes": lambda reply: put(b"\xff\xfe\xfd\n"),
    "endless": lambda reply: forever(b"x" * 65_536),
    "deep": lambda reply: put(b'{"message":"sample","ns":' + b"[" * 100_000 + b"\n"),
    "other": lambda reply: say(another(reply["message"])),
    "overflow": number("1e400"),
    "negative": number("-1"),
    "zero": number("0"),
    "great": number("1e308"),
    "small": number("5e-324"),
    "words": number('"1"'),
    "null": number("null"),
    "many": lists(lambda value: value * 10_000),
    "none-of-it": lists(lambda value: []),
    "named": lambda reply: say({key: named(value) for key, value in reply.items()}),
    "refused": lambda reply: say(FAULT | {"fatal": False}),
    "fatal": lambda reply: say(FAULT | {"fatal": True}),
    "unsupported": lambda reply: say({"message": "unsupported", "request": LONG}),
    "killed": die,
    "failed": lambda reply: sys.exit(1),
    "ended": lambda reply: sys.exit(0),
    "mute": mute,
    "orphan": orphan,
    "silent": lambda reply: linger(),
    "twice": lambda reply: [say(reply), say(reply)],
    "flood": lambda reply: [say(reply), forever(json.dumps({"message": "sample", "ns": [1.0]}).encode() + b"\n")],
    "garbled": garbled,
}


def note(pid):
    with open(LOG + ".processes", "a") as file:
        file.write(f"{pid}\n")


def is_due():
    with open(LOG + ".asked", "a") as file:
        file.write(".")
    return os.path.getsize(LOG + ".asked") >= int(AT)


def main():
    note(os.getpid())
    misbehave = WAYS[WAY]
    if STEP == "start" and WAY != "usual":
        misbehave({"message": "hello"})
    while line := sys.stdin.readline():
        request = json.loads(line)
        message = request["message"]
        reply = {"message": "prepared" if message == "prepare" else message} | (usual(request) or {})
        if message == STEP and WAY != "usual" and is_due():
            misbehave(reply)
        elif message == "quit":
            return
        else:
            say(reply)


main()
