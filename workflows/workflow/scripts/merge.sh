#!/usr/bin/env bash
# merge.sh OUT MONITOR SHARD...: join shards, in order, to OUT; MONITOR is the command that measured them, as text.
# A bond that broke in one shard is unknown to those behind it, which were measured at the same time; 'mdtopo merge'
# then refuses, and names the frames to measure in one run instead of the two at the seam. That is done here. Where that
# run ends with a bond that the next shard does not know either, all the rest is measured in one run: no frame is
# measured more than three times, however many shards there are.
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

while :; do
    code=0
    mdtopo merge --overwrite "${shards[@]}" -o "$out" 2> "$refused" || code=$?
    cat "$refused" >&2
    after=$(unknowing)
    if [ "$code" -eq 0 ] || [ -z "$after" ]; then
        exit "$code"
    fi
    before=${shards[after - 1]}
    last=$after
    [[ $(basename "$before") == again-* ]] && last=$((${#shards[@]} - 1))

    IFS=- read -r begin _ step <<< "$(basename "${before/again-/}" .h5)"
    IFS=- read -r _ stop _ <<< "$(basename "${shards[last]}" .h5)"
    frames="$begin:$stop${step:+:$step}"
    again="$(dirname "$before")/again-${frames//:/-}.h5"
    echo "mdtopo: measuring the frames $frames in one run"
    eval "$monitor --quiet --overwrite --frames $frames -o '$again'" || exit
    shards=("${shards[@]:0:after-1}" "$again" "${shards[@]:last+1}")
done
