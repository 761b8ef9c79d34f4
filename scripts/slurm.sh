#!/bin/sh
# One run as a job array of Slurm: a task per shard, and a job that reports the shards together when all tasks have ended.
# usage: scripts/slurm.sh SHARDS FOLDER [options of `fathom run`]
# FATHOM names the program (default: target/release/fathom); SBATCH_OPTIONS goes to both calls of sbatch.
set -eu
[ $# -ge 2 ] || { sed -n 's/^# usage: /usage: /p' "$0" >&2; exit 2; }
shards=$1 folder=$2
shift 2
FATHOM=$(realpath "${FATHOM:-target/release/fathom}")
mkdir -p "$folder"
cd "$folder"
cat >task.sh <<'TASK'
#!/bin/sh
# A shard that has records goes on with them, as after a requeue.
shard=shards/$SLURM_ARRAY_TASK_ID
[ ! -e "$shard/records.jsonl" ] || set -- "$@" --resume
exec "$FATHOM" run --shard "$SLURM_ARRAY_TASK_ID/$SHARDS" --out "$shard" "$@"
TASK
export FATHOM SHARDS="$shards"
# shellcheck disable=SC2086
job=$(sbatch --parsable --requeue --array="1-$shards" ${SBATCH_OPTIONS:-} task.sh "$@")
# shellcheck disable=SC2086,SC2016
sbatch --dependency="afterany:${job%%;*}" ${SBATCH_OPTIONS:-} --wrap \
    'mkdir whole whole/renders && awk 1 shards/*/records.jsonl >whole/records.jsonl && { cp shards/*/renders/* whole/renders; "$FATHOM" report whole; }'
