import csv
import shlex
from pathlib import Path

from snakemake.exceptions import WorkflowError
from snakemake.utils import validate

validate(config, schema="../schemas/config.schema.yaml")


def read_samples(path):
    """Return the samples by name, or refuse the table with every fault that it has."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = [line for line in file if line.strip() and not line.startswith("#")]
    rows = [{key: value for key, value in row.items() if value} for row in csv.DictReader(lines, delimiter="\t")]
    faults = [] if rows else [f"{path} names no sample."]
    samples = {}
    for row in rows:
        validate(row, schema="../schemas/samples.schema.yaml")
        name = row["sample"]
        if name in samples:
            faults.append(f"{path} names the sample {name} twice.")
        for file in input_files(row):
            if not Path(file).is_file():
                faults.append(f"Sample {name}: {file} does not exist.")
        samples[name] = row
    if faults:
        raise WorkflowError("\n".join(faults))
    return samples


def input_files(row):
    """Return the topology and the trajectory files of a sample."""
    return [row["topology"], *row.get("trajectory", "").split()]


def input_options(row):
    """Return what the table and the configuration say of how an input is read, as words for the shell."""
    words = ["--config", config["options"]] if config["options"] else []
    words += ["--select", row["select"]] if "select" in row else []
    return shlex.join(words)


def monitor_command(wildcards, files, threads, resources):
    """Return the command that measures a sample, but for the frames and the output, as text for the shell."""
    options = f"{input_options(SAMPLES[wildcards.sample])} --threads {threads} {hours_option(resources)}"
    return f"mdtopo monitor {options} {shlex.join(files)}"


def frames_option(row):
    """Return the frame range of a sample, as words for the shell."""
    return shlex.join(["--frames", row["frames"]]) if "frames" in row else ""


def hours_option(resources):
    """Return when a job is to stop by itself, ahead of the end of its time, as words for the shell."""
    minutes = resources.get("runtime")
    if not isinstance(minutes, (int, float)):
        return ""
    return f"--max-hours {max(minutes - config['stop-ahead'], 0.5 * minutes) / 60.0:.4f}"


def shard_files(wildcards):
    """Return the results of all shards of a sample, in order."""
    with checkpoints.shards.get(sample=wildcards.sample).output.frames.open() as file:
        names = [line.strip().replace(":", "-") for line in file]
    return [f"results/{wildcards.sample}/shards/{name}.h5" for name in names]


def unfinished():
    """Return what keeps each unfinished sample from its results, in words."""
    lines = ["mdtopo: what is not finished:"]
    for sample in SAMPLES:
        if Path(f"results/{sample}/{sample}.h5").exists():
            continue
        logs = sorted(Path(f"results/{sample}").rglob("*.log"), key=lambda log: log.stat().st_mtime)
        said = [line for log in logs for line in log.read_text().splitlines() if line.startswith("mdtopo: ")]
        lines.append(f"  {sample}: {said[-1] if said else 'not reached'}")
    return "\n".join(lines)


# on a cluster the workflow is read again within each job: a job that was checkpointed must end there, so that the
# next one gets the whole of its time
RESUMES = 0 if workflow.remote_exec else config["resumes"]

SAMPLES = read_samples(config["samples"])


wildcard_constraints:
    sample="[A-Za-z0-9._-]+",
    frames="[0-9]+-[0-9]+(-[0-9]+)?",
