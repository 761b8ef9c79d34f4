"""Stored lines are as the committed schemas have them; with the first of its keys renamed, none is."""
import json
from pathlib import Path

from jsonschema import Draft202012Validator

root = Path(__file__).parents[2]
STORED = {"record": ["run/records", "lines/record"], "worker-protocol": ["lines/worker"]}
for schema, files in STORED.items():
    validator = Draft202012Validator(json.loads((root / f"docs/{schema}.schema.json").read_text()))
    Draft202012Validator.check_schema(validator.schema)
    for line in (line for file in files for line in (root / f"tests/golden/{file}.jsonl").read_text().splitlines()):
        validator.validate(json.loads(line))
        assert not validator.is_valid(json.loads(line.replace('"', '"?', 1))), line
