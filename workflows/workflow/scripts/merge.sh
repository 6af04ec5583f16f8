#!/usr/bin/env bash
# merge.sh OUT MONITOR SHARD...: join shards, in order, to OUT; MONITOR is the command that measured them, as text.
# A bond that broke in one shard is unknown to those behind it, which were measured at the same time; 'mdtopo merge'
# then refuses, and names the shard. It is measured again here, with the bonds that the shard before ends with; and so
# are those behind it, as far as they did not know of the bond either. No frame is measured more than twice.
set -uo pipefail
out=$1 monitor=$2
shift 2
shards=("$@")

refused=$(mktemp)
trap 'rm -f "$refused"' EXIT

# index of the shard that the refusal says did not know of a bond; nothing where it was refused for another reason
unknowing() {
    local index
    for ((index = 1; index < ${#shards[@]}; index++)); do
        if grep -qF "which ${shards[index]} did not know when it began" "$refused"; then
            echo "$index"
            return
        fi
    done
}

measure() { # SHARD FRAMES BEFORE OPTION...: a shard again
    eval "$monitor --quiet --frames $2 --broken-from '$3' -o '$1' ${*:4}"
}

while :; do
    code=0
    mdtopo merge --overwrite "${shards[@]}" -o "$out" 2> "$refused" || code=$?
    cat "$refused" >&2
    index=$(unknowing)
    if [ "$code" -eq 0 ] || [ -z "$index" ]; then
        exit "$code"
    fi
    name=$(basename "${shards[index]}" .h5)
    if [[ $name == again-* ]]; then
        exit "$code" # it did know: what is wrong is something else
    fi
    again="$(dirname "${shards[index]}")/again-$name.h5"
    echo "mdtopo: measuring the frames ${name//-/:} again"
    code=0
    measure "$again" "${name//-/:}" "${shards[index - 1]}" || code=$?
    if [ "$code" -eq 4 ]; then # what a job before this one has measured goes on, unless it is of another input
        code=0
        measure "$again" "${name//-/:}" "${shards[index - 1]}" --overwrite || code=$?
    fi
    if [ "$code" -ne 0 ]; then
        exit "$code"
    fi
    shards[index]=$again
done
