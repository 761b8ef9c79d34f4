"""A worker of `fathom compare` that is not fathom: a loop on the CPU, by Python's standard library alone.

The protocol is docs/worker-protocol.md. `--turns 1.05` makes 5 % more turns, so that two sides differ.
`--counted` tells a picosecond for each turn in place of the time of the process, so that figures have no noise.
"""

import argparse
import json
import platform
import sys
import time

ADAPTER = {
    "name": platform.processor() or platform.machine(),
    "backend": "python",
    "device_type": "Cpu",
    "driver": "CPython",
    "driver_info": platform.python_version(),
    "vendor_id": 0,
    "device_id": 0,
    "software": True,
    "timestamp_period_ns": 1.0,
    "host_threads": 1,
}


def kernel(turns):
    total = 0.0
    for turn in range(turns):
        total += turn * 0.5
    return total


def sampled(turns, counted):
    if counted:
        return 0.001 * turns
    start = time.process_time_ns()
    kernel(turns)
    return max(time.process_time_ns() - start, 1)


def answer(request, configurations, options):
    match request["message"]:
        case "hello":
            return {"message": "hello", "protocol": 1, "fathom_version": "own 1.0", "adapter": ADAPTER, "parts": ["time"]}
        case "prepare":
            configurations[request["id"]] = int(request["params"].get("turns", 10_000))
            return {"message": "prepared", "stages": [{"name": "sum", "kind": "host"}]}
        case "sample" if request["config"] in configurations:
            turns = round(configurations[request["config"]] * options.turns)
            return {"message": "sample", "ns": [sampled(turns, options.counted) for _ in range(request["frames"])]}
        case "sample":
            return {"message": "fault", "reason": "not prepared", "fatal": False, "absent": False}
        case unknown:
            return {"message": "unsupported", "request": unknown}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--turns", type=float, default=1.0)
    parser.add_argument("--counted", action="store_true")
    options = parser.parse_args()
    configurations = {}
    for line in sys.stdin:
        request = json.loads(line)
        if request["message"] == "quit":
            return
        print(json.dumps(answer(request, configurations, options)), flush=True)


main()
