#!/usr/bin/env bash
# Runs the smoke graph on a Slurm of one node, started here, by profiles/slurm, and compares its tables, byte for byte but
# for the seconds that rows took, with those of a run without Slurm: results/smoke, made here where they are missing.
# Needs fimpact in .venv or an active environment, root, and Debian's slurm-wlm or a way to install it; says so and ends
# with 0 where it has none of that.
#   tests/slurm_smoke.sh [TARGET ...]    default: the tables of the smoke graph
set -euo pipefail
cd "$(dirname "$0")/.."

unchecked() {
    echo "Slurm: not checked: $*" >&2
    exit 0
}

timeless() { # a table without how long its rows took
    if head -n 1 "$1" | grep -q ',seconds$'; then sed 's/,[^,]*$//' "$1"; else cat "$1"; fi
}

[ -d .venv ] && PATH="$PWD/.venv/bin:$PATH"
[ "$(id -u)" = 0 ] || unchecked "slurmd needs root"
if ! { command -v slurmctld && command -v slurmd && command -v sbatch && command -v munged; } >/dev/null; then
    command -v apt-get >/dev/null || unchecked "no slurm-wlm here, and no apt-get to install it"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update && apt-get install -y --no-install-recommends slurm-wlm munge; } >/dev/null 2>&1 ||
        unchecked "apt-get cannot install slurm-wlm"
fi
python -c "import snakemake_executor_plugin_slurm" 2>/dev/null ||
    python -m pip install -q -c constraints.txt -e '.[slurm]' || unchecked "pip cannot install fimpact[slurm]"

cluster=$(mktemp -d) node=$(hostname -s)
stop() {
    scancel --full --state=RUNNING --state=PENDING 2>/dev/null || true
    for daemon in slurmd slurmctld munged; do
        pid=$(cat "$cluster/$daemon.pid" 2>/dev/null) || continue
        kill "$pid" 2>/dev/null && tail --pid="$pid" -f /dev/null
    done
    rm -rf "$cluster"
}
trap stop EXIT

free_ports="import socket; s = [socket.create_server(('', 0)) for _ in 'ab']; print(*[x.getsockname()[1] for x in s])"
read -r control work < <(python -c "$free_ports")

# A socket, ports and folders of its own, so that a Slurm that is here already is left alone; no cgroups, which
# containers forbid.
export SLURM_CONF="$cluster/slurm.conf"
mkdir "$cluster/state" "$cluster/spool" "$cluster/bin"
# Within a job the plugin takes SLURM_CONF away from srun, which then looks in /etc/slurm.
printf '#!/bin/sh\nSLURM_CONF=%s exec %s "$@"\n' "$SLURM_CONF" "$(command -v srun)" >"$cluster/bin/srun"
chmod +x "$cluster/bin/srun"
export PATH="$cluster/bin:$PATH"
chmod 755 "$cluster"
(umask 077 && head -c 128 /dev/urandom >"$cluster/munge.key")
cat >"$SLURM_CONF" <<END
ClusterName=smoke
SlurmctldHost=$node(127.0.0.1)
SlurmctldPort=$control
SlurmdPort=$work
SlurmUser=root
SlurmdUser=root
AuthInfo=socket=$cluster/munge.socket
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
MinJobAge=600
StateSaveLocation=$cluster/state
SlurmdSpoolDir=$cluster/spool
SlurmctldPidFile=$cluster/slurmctld.pid
SlurmdPidFile=$cluster/slurmd.pid
SlurmctldLogFile=$cluster/slurmctld.log
SlurmdLogFile=$cluster/slurmd.log
$(slurmd -C | grep -o 'CPUs=[0-9]*' | sed "s/^/NodeName=$node NodeAddr=127.0.0.1 /") $(slurmd -C | grep -o 'RealMemory=[0-9]*')
PartitionName=all Nodes=ALL Default=YES
END
munged --force --key-file="$cluster/munge.key" --socket="$cluster/munge.socket" --pid-file="$cluster/munged.pid" \
    --log-file="$cluster/munged.log" --seed-file="$cluster/munge.seed"
slurmctld -i
slurmd
for _ in $(seq 30); do
    state=$(sinfo -h -o %T 2>/dev/null || true)
    [ "$state" != idle ] || break
    sleep 1
done
[ "$state" = idle ] || { tail "$cluster"/slurm*.log >&2 && unchecked "the node does not start"; }

tables=(trials diagnostics sweep reach)
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=("${tables[@]/%/.csv}")
smoke=(--configfile config/smoke.yaml)
for table in "${targets[@]}"; do
    [ -e "results/smoke/$table" ] || snakemake "results/smoke/$table" "${smoke[@]}"
done
rm -rf results/slurm
snakemake "${targets[@]/#/results/slurm/}" --workflow-profile profiles/slurm "${smoke[@]}" \
    --config results=results/slurm --slurm-status-command squeue --slurm-init-seconds-before-status-checks 5
for table in "${targets[@]}"; do
    cmp <(timeless "results/smoke/$table") <(timeless "results/slurm/$table") || { echo "$table differs" >&2 && exit 1; }
done
echo "Slurm: the same bytes by $(scontrol -o show job | grep -c JobState=COMPLETED) jobs: ${targets[*]}"
rm -rf results/slurm
