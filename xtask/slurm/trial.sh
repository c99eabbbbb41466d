#!/usr/bin/env bash
# Shards with real Slurm on loopback: job arrays, a task killed on the way, a merge that waits for all, the same again,
# compared with single runs without Slurm. Takes some minutes; what failed is left in a folder of /tmp.
#
#   cargo build --release && xtask/slurm/trial.sh [PROGRAMS]    (Debian: slurm-wlm, munge, jq)
set -euo pipefail

here=$(cd "$(dirname "$0")" && pwd)
programs=$(cd "${1:-$here/../../target/release}" && pwd)
model=$here/../../infer/models/maze-small.safetensors
export PATH="$programs:$PATH:/usr/local/sbin:/usr/sbin"
for program in tactile-data tactile-filter munged mungekey slurmctld slurmd sbatch jq; do
    command -v "$program" > /dev/null || { echo "trial: $program is not installed" >&2; exit 1; }
done
# A socket's path is at most 107 bytes long.
run=$(mktemp -d /tmp/slurm-trial.XXXXXX)
work=$run/work
mkdir -p "$run/state" "$run/spool" "$work"
chmod 755 "$run"

say() { echo "slurm: $*"; }
fail() { echo "trial: $* (see $run)" >&2; exit 1; }
# Until a command says yes: `until_so WHAT COMMAND...`.
until_so() {
    local what=$1 end=$((SECONDS + 600))
    shift
    until "$@"; do
        [ $SECONDS -lt $end ] || fail "$what: expected within 600 s"
        sleep 0.1
    done
}
stop() {
    scancel --partition=walk 2> /dev/null || true
    sleep 1
    kill $(jobs -p) 2> /dev/null || true
    wait || true
    [ -z "$passed" ] || rm -rf "$run"
}
passed=
trap stop EXIT

# The cluster: munge, the controller, one node of two processors.
sed -e '/^#/d' -e "s|FOLDER|$run|; s|=USER|=$(id -un)|; s|CONTROLLER_PORT|${CONTROLLER_PORT:-16817}|
    s|NODE_PORT|${NODE_PORT:-16818}|; s|N_CPUS|2|" "$here/slurm.conf" > "$run/slurm.conf"
export SLURM_CONF=$run/slurm.conf
mungekey --create --keyfile "$run/munge.key"
munged --foreground --key-file="$run/munge.key" --socket="$run/munge.socket" --pid-file="$run/munge.pid" \
    --log-file="$run/munge.log" --seed-file="$run/munge.seed" > "$run/munged.out" 2>&1 &
until_so "munge's socket" test -S "$run/munge.socket"
slurmctld -D -f "$SLURM_CONF" > "$run/slurmctld.out" 2>&1 &
is_up() { scontrol ping 2> /dev/null | grep -q ' is UP'; }
until_so "the controller" is_up
slurmd -D -N localhost -f "$SLURM_CONF" > "$run/slurmd.out" 2>&1 &
is_idle() { [ "$(sinfo --noheader --format=%T 2> /dev/null)" = idle ]; }
until_so "an idle node" is_idle
say "a cluster of one node in $run"
cd "$work"

of() { scontrol --oneliner show job "$1" | tr ' ' '\n' | sed -n "s/^$2=//p"; }
is_over() { ! of "$1" JobState | grep -qE 'PENDING|CONFIGURING|RUNNING|COMPLETING|SUSPENDED|REQUEUED'; }
# All of a job or of an array's tasks done, and so many times back in the queue in all.
ended() {
    until_so "the end of job $1" is_over "$1"
    of "$1" JobState | grep -qv COMPLETED && fail "job $1: expected all of it COMPLETED, got $(of "$1" JobState | xargs)"
    local restarts=$(($(of "$1" Restarts | paste -sd+)))
    [ "$restarts" = "$2" ] || fail "job $1: expected $2 restarts, got $restarts"
}
# A task's number of its own is known once it runs.
process() {
    local job
    job=$(of "$1" JobId)
    for pid in $(scontrol listpids "$job" 2> /dev/null | awk -v job="$job" '$2 == job { print $1 }'); do
        [ "$(cat "/proc/$pid/comm" 2> /dev/null)" = "$2" ] && return
    done
    return 1
}
is_back() { [ "$(of "$1" Restarts) $(of "$1" JobState)" = "1 PENDING" ]; }

# NAME PROGRAM SHARDS HALF_DONE MERGE ARGUMENT...: an array of four tasks, the second of them killed, and a merge.
try() {
    local name=$1 program=$2 shards=$3 half_done=$4 merge=$5 array job task
    shift 5
    array() {
        sbatch --parsable --array=1-4 --export="ALL,PROGRAMS=$programs" "$here/shards.sbatch" "$program" "$@" --shard env \
            --out "$shards"
    }
    "$program" "$@" --out "$name-single" > /dev/null
    array=$(array "$@")
    job=$(sbatch --parsable --output=slurm-%j.out --dependency="afterok:$array" --wrap="$merge")
    until_so "$half_done" test -e "$half_done"
    until_so "$program in task 2" process "${array}_2" "$program"
    kill -KILL "$pid"
    until_so "task 2 back in the queue" is_back "${array}_2"
    # Slurm lets a job that comes back wait for two minutes.
    scontrol update "JobId=${array}_2" StartTime=now
    ended "$array" 1
    ended "$job" 0
    say "$name: all tasks done, the killed one after one restart; merged"
    array=$(array "$@")
    ended "$array" 0
    for task in 1 2 3 4; do
        grep -q already "slurm-${array}_$task.out" || fail "slurm-${array}_$task.out: expected a shard that is there already"
    done
    say "$name: the same again: all shards were there already"
}

try generate tactile-data shards/maze-%a shards/maze-2.partial 'tactile-data merge shards/maze-* --out generate' \
    generate --scene maze --pairs 8000 --boards 8 --frame-px 80x60
sums() { (cd "$1" && sha256sum frames.npy index.jsonl meta.json no_contact.png); }
diff <(sums generate) <(sums generate-single) || fail "the merged dataset is another than the single run's"

tactile-data generate --out pegs --scene alphabet-small --sides peg > /dev/null
tactile-infer bank --model "$model" --data pegs --out pegs.bank > /dev/null
try evaluate tactile-filter episodes . 'tactile-filter merge episodes --out evaluate' \
    evaluate --model "$model" --bank pegs.bank --episodes 600 --engines exact --actions information --scene alphabet-small
# But for how long it took, on what and by which command.
found() { jq -S 'del(.latency_ms, .n_threads, .command)' "$1/evaluation.json"; }
diff <(found evaluate) <(found evaluate-single) || fail "the merged evaluation is another than the single run's"
passed=yes
say "passed; shards killed, restarted and merged are what single runs make"
