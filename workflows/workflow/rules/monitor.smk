checkpoint shards:
    input:
        lambda wildcards: input_files(SAMPLES[wildcards.sample]),
    output:
        frames="results/{sample}/shards.txt",
    params:
        reading=lambda wildcards: input_options(SAMPLES[wildcards.sample]),
        frames=lambda wildcards: frames_option(SAMPLES[wildcards.sample]),
        steps=config["shard-steps"],
    log:
        "results/{sample}/shards.log",
    conda:
        "../envs/mdtopo.yaml"
    shell:
        "mdtopo shards --steps {params.steps} {params.reading} {params.frames} {input} > {output.frames} 2> {log}"


rule monitor:
    input:
        lambda wildcards: input_files(SAMPLES[wildcards.sample]),
    output:
        "results/{sample}/shards/{frames}.h5",
    params:
        reading=lambda wildcards: input_options(SAMPLES[wildcards.sample]),
        frames=lambda wildcards: wildcards.frames.replace("-", ":"),
        hours=lambda wildcards, resources: hours_option(resources),
        resumable=workflow.source_path("../scripts/resumable.sh"),
    log:
        "results/{sample}/shards/{frames}.log",
    retries: RESUMES
    threads: config["threads"]
    resources:
        attempt=lambda wildcards, attempt: attempt,
    conda:
        "../envs/mdtopo.yaml"
    shell:
        "bash {params.resumable} {resources.attempt} {log} "
        "mdtopo monitor {params.reading} --frames {params.frames} --threads {threads} {params.hours} "
        "-o {output} {input}"


rule merge:
    input:
        shards=shard_files,
        files=lambda wildcards: input_files(SAMPLES[wildcards.sample]),
    output:
        "results/{sample}/{sample}.h5",
    params:
        monitor=lambda wildcards, input, threads, resources: monitor_command(
            wildcards, input.files, threads, resources
        ),
        joining=workflow.source_path("../scripts/merge.sh"),
        resumable=workflow.source_path("../scripts/resumable.sh"),
    log:
        "results/{sample}/merge.log",
    retries: RESUMES
    threads: config["threads"]
    resources:
        attempt=lambda wildcards, attempt: attempt,
    conda:
        "../envs/mdtopo.yaml"
    shell:
        "bash {params.resumable} {resources.attempt} {log} "
        "bash {params.joining} {output} {params.monitor:q} {input.shards}"
