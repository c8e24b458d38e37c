#!/usr/bin/env bash
# Many records as a Slurm job array: one shard for each task, then one table. docs/batch.md tells how.
#
#   shards=$(sbatch --parsable --array=1-4 slurm-array.sh)
#   sbatch --dependency=afterok:$shards --export=ALL,SHARDS=4 slurm-array.sh merge
#
#SBATCH --job-name=whirl
#SBATCH --cpus-per-task=2
#SBATCH --requeue
set -euo pipefail

records=${RECORDS:-records/*.parquet}
rig=${RIG:-rig.toml}
command=${COMMAND:-identify}
options=${OPTIONS:-}
table=${TABLE:-table.parquet}
whirl=${WHIRL:-whirl}
mkdir -p shards

# Patterns and options are words on purpose.
# shellcheck disable=SC2086
if [ "${1:-}" = merge ]; then
  # Exit status 1 says, as below, that some row is negative or failed.
  $whirl batch merge $(seq -f "shards/%g.${table##*.}" 1 "$SHARDS") --out "$table" --force || [ $? -eq 1 ]
  exit 0
fi
shard=$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT
# Exit status 1 says that some record's answer is negative or that it failed: its row says why, and the table is whole.
# --resume goes on where a task was that was killed and queued again.
# shellcheck disable=SC2086
$whirl batch $command $records --rig "$rig" $options --shard "$shard" --resume \
  --out "shards/$SLURM_ARRAY_TASK_ID.${table##*.}" --threads "${SLURM_CPUS_PER_TASK:-1}" || [ $? -eq 1 ]
