# Real recordings: fetch what is published, diagnose each case, let others try, one table of all.


# Only files that are not there: what someone has put in the data folder is theirs, and never made again.
rule fetch:
    output:
        f"{DATA}/{{file}}",
    log:
        "<recordings>/logs/fetch/{file}.log",
    wildcard_constraints:
        file="|".join(map(re.escape, MISSING)) or "(?!)",
    params:
        source=lambda wildcards: find_source(SOURCES, wildcards.file),
    message:
        "fetch {params.source.url}"
    script:
        "../scripts/fetch.py"


rule fetch_all:
    input:
        expand("{data}/{file}", data=DATA, file=MISSING),


rule recordings:
    input:
        expand("<recordings>/{case}/report.html", case=CASES),
        "<recordings>/summary.csv",


rule diagnose_recording:
    input:
        case="config/recordings/{case}.yaml",
        data=case_inputs,
        code=diagnosing(),
    output:
        page="<recordings>/{case}/report.html",
        found="<recordings>/{case}/diagnosis.json",
        timing="<recordings>/{case}/timing.json",
    log:
        "<recordings>/logs/diagnose/{case}.log",
    wildcard_constraints:
        case="|".join(map(re.escape, KNOWN)),
    threads: 8  # or all, where there are fewer; a cluster has no such number
    params:
        data=DATA,
    message:
        "diagnose {wildcards.case}"
    script:
        "../scripts/diagnose_recording.py"


rule compare_recording:
    input:
        case="config/recordings/{case}.yaml",
        data=case_inputs,
        code=code("compare_recording") + ["src/fimpact/cases/schema.yaml"],
    output:
        "<recordings>/compared/{case}.csv",
    log:
        "<recordings>/logs/compare/{case}.log",
    wildcard_constraints:
        case="|".join(map(re.escape, KNOWN)),
    threads: 1
    params:
        data=DATA,
        limit=config["recordings"]["limit"],
    message:
        "comparators on {wildcards.case}"
    script:
        "../scripts/compare_recording.py"


rule recordings_summary:
    input:
        diagnoses=expand("<recordings>/{case}/diagnosis.json", case=CASES),
        timings=expand("<recordings>/{case}/timing.json", case=CASES),
        compared=expand("<recordings>/compared/{case}.csv", case=CASES),
        code=code("recordings_summary"),
    output:
        summary=report("<recordings>/summary.csv", caption="../report/recordings.rst", category="Recordings"),
        peers="<recordings>/peers.csv",
        text="<recordings>/summary.md",
    log:
        "<recordings>/logs/summary.log",
    params:
        rigs=CASES,
    message:
        "summarise the recordings"
    script:
        "../scripts/recordings_summary.py"


rule recordings_reference:
    input:
        "<recordings>/summary.csv",
        "<recordings>/peers.csv",
    log:
        "<recordings>/logs/reference.log",
    params:
        folder=f"results/reference/{Path(config['recordings']['results']).name}",
    message:
        "copy the recordings' tables to {params.folder}"
    shell:
        "mkdir -p {params.folder} && cp -v {input} {params.folder} > {log} 2>&1"
