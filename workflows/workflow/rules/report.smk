rule report:
    input:
        expand("results/{sample}/{sample}.h5", sample=SAMPLES),
    output:
        page="results/report/overview.html",
    log:
        "results/report/report.log",
    conda:
        "../envs/mdtopo.yaml"
    shell:
        # writes a page for each sample, and what MultiQC takes of it, beside the overview
        "mdtopo report --multiqc --overwrite {input} -o {output.page} > {log} 2>&1"
