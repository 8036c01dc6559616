#!/usr/bin/env bash
# Ends what start.sh began in FOLDER.
set -uo pipefail
folder=$1
for name in slurmd slurmctld; do
    [ -f "$folder/$name.pid" ] && kill "$(cat "$folder/$name.pid")" 2> /dev/null
done
munge=$(cat "$folder/munge" 2> /dev/null) || exit 0
[ -f "$munge/pid" ] && kill "$(cat "$munge/pid")" 2> /dev/null
rm -rf "$munge"
