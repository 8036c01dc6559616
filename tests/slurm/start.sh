#!/usr/bin/env bash
# A Slurm of one node, for the tests: munged, slurmctld and slurmd as daemons of their own in a folder, without systemd and
# without cgroups. Prints the line that makes the Slurm commands use it.
#
#     eval "$(tests/slurm/start.sh FOLDER)"      # then sbatch, squeue, scancel work
#     tests/slurm/stop.sh FOLDER
#
# Needs root and Debian's packages slurm-wlm and munge.
set -euo pipefail
folder=$(mkdir -p "$1" && cd "$1" && pwd)
host=$(hostname -s)
cores=$(nproc)
say() { echo "slurm: $*" >&2; }

for program in munged slurmctld slurmd sbatch; do
    command -v "$program" > /dev/null || PATH=$PATH:/usr/sbin:/sbin
    command -v "$program" > /dev/null || { say "no $program: apt-get install slurm-wlm munge"; exit 3; }
done
[ "$(id -u)" = 0 ] || { say "needs root"; exit 3; }

# munged refuses folders that others may write to: /tmp is one of them, so its own files live under /run.
munge=/run/quadrille-munge-$$
install -d -m 0700 "$munge"
install -d -m 0755 "$folder/state" "$folder/spool" "$folder/log"
dd if=/dev/urandom of="$munge/key" bs=1 count=1024 status=none
chmod 0400 "$munge/key"
chmod 0711 "$munge"
munged --force --num-threads=2 --key-file="$munge/key" --socket="$munge/socket" --pid-file="$munge/pid" \
    --log-file="$munge/log" --seed-file="$munge/seed"
echo "$munge" > "$folder/munge"

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }
cat > "$folder/slurm.conf" << CONF
ClusterName=quadrille
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmdPort=$(free_port)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket=$munge/socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/log/slurmctld.log
SlurmdLogFile=$folder/log/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SchedulerType=sched/backfill
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
ReturnToService=2
KillWait=5
MinJobAge=3600
AccountingStorageType=accounting_storage/none
JobAcctGatherType=jobacct_gather/none
SchedulerParameters=sched_interval=1,batch_sched_delay=0
NodeName=$host NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=test Nodes=$host Default=YES MaxTime=INFINITE State=UP
CONF
export SLURM_CONF=$folder/slurm.conf
slurmctld -c -f "$SLURM_CONF"
slurmd -c -f "$SLURM_CONF"
for _ in $(seq 60); do
    case $(sinfo -h -o %t 2> /dev/null) in
        idle) break ;;
    esac
    sleep 0.5
done
state=$(sinfo -h -o %t 2>&1) || true
if [ "$state" != idle ]; then
    say "the node is '$state', not idle"
    tail -n 20 "$folder"/log/*.log >&2
    exit 1
fi
echo "export SLURM_CONF=$SLURM_CONF PATH=\$PATH:/usr/sbin:/sbin"
