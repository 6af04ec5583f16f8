#!/usr/bin/env bash
# resumable.sh ATTEMPT LOG COMMAND...: run a command whose exit code 75 means "checkpointed, run me again".
# Snakemake tries a failed job again whatever its code was. Only 75 deserves it: any other failure would come back, so
# its code and its log are kept, and later attempts of the same run of the workflow repeat them without doing the work.
set -uo pipefail
attempt=$1 log=$2
shift 2
failure="$log.failed"
if [ "$attempt" -gt 1 ] && [ -e "$failure" ]; then
    tail -n +2 "$failure" > "$log"
    exit "$(head -n 1 "$failure")"
fi
rm -f "$failure"
code=0
"$@" >> "$log" 2>&1 || code=$?
if [ "$code" -eq 75 ]; then
    echo "mdtopo: attempt $attempt was checkpointed; the next one goes on where it stopped."
elif [ "$code" -ne 0 ]; then
    { echo "$code"; cat "$log"; } > "$failure"
fi
exit "$code"
