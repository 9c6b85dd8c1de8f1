# The blind benchmark: plant and seal, diagnose from recordings alone, play what was asked for, open the seals, score.
# Only `conceal`, `reveal`, `grade` and `score` touch sealed/. A part is finished before another is begun (`priority`).

PICTURES = ["confusion", "held-out", "calibration", "detection"]


rule concealed:
    input:
        "<concealed>/measures.md",
        "<concealed>/strata.csv",
        "<concealed>/entered.csv" if whole() else [],
        expand("<concealed>/{figure}.svg", figure=PICTURES),


rule conceal:
    input:
        code=planting(),
    output:
        recordings=directory("<concealed>/recordings/{scatteritem}"),
        sealed=directory("<concealed>/sealed/{scatteritem}"),
        made="<concealed>/made/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/conceal/{scatteritem}.log",
    threads: 1
    params:
        settings={key: BENCHMARK[key] for key in ("seed", "cases", "rigs", "lambda")},
        cases=part_of_cases,
    message:
        "conceal part {wildcards.scatteritem}"
    script:
        "../scripts/conceal.py"


rule diagnose_concealed:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        code=code("diagnose"),
    output:
        diagnoses="<concealed>/diagnoses/{scatteritem}.jsonl",
        commands="<concealed>/commands/{scatteritem}.npz",
    log:
        "<concealed>/logs/diagnose/{scatteritem}.log",
    priority: 1
    threads: 1
    message:
        "diagnose part {wildcards.scatteritem}"
    script:
        "../scripts/diagnose_concealed.py"


rule reveal:
    input:
        sealed="<concealed>/sealed/{scatteritem}",
        commands="<concealed>/commands/{scatteritem}.npz",
        code=planting(),
    output:
        "<concealed>/revealed/{scatteritem}.npz",
    log:
        "<concealed>/logs/reveal/{scatteritem}.log",
    priority: 2
    threads: 1
    params:
        played=compared_cases("played"),
    message:
        "play the experiments of part {wildcards.scatteritem}"
    script:
        "../scripts/reveal.py"


rule resolve:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        diagnoses="<concealed>/diagnoses/{scatteritem}.jsonl",
        commands="<concealed>/commands/{scatteritem}.npz",
        revealed="<concealed>/revealed/{scatteritem}.npz",
        code=code("diagnose"),
    output:
        "<concealed>/resolved/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/resolve/{scatteritem}.log",
    priority: 3
    threads: 1
    message:
        "resolve the sets of part {wildcards.scatteritem}"
    script:
        "../scripts/resolve.py"


rule peers:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        code=code("peers"),
    output:
        "<concealed>/peers/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/peers/{scatteritem}.log",
    priority: 4
    threads: 1
    params:
        compared=compared_cases(),
        refitted=compared_cases("refitted"),
    message:
        "comparators on part {wildcards.scatteritem}"
    script:
        "../scripts/peers.py"


rule enter:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        code=code("enter"),
    output:
        "<concealed>/entries/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/enter/{scatteritem}.log",
    priority: 4
    threads: 1
    params:
        entered=entered_cases(),
    message:
        "other tools on part {wildcards.scatteritem}"
    script:
        "../scripts/enter.py"


rule grade:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        sealed="<concealed>/sealed/{scatteritem}",
        entries="<concealed>/entries/{scatteritem}.jsonl",
        code=code("grade"),
    output:
        "<concealed>/grades/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/grade/{scatteritem}.log",
    priority: 5
    threads: 1
    message:
        "open the seals of part {wildcards.scatteritem} and grade other tools"
    script:
        "../scripts/grade.py"


rule concealed_entered:
    input:
        parts=lambda wildcards: parts_of_cases("grades"),
    output:
        "<concealed>/entered.csv",
    log:
        "<concealed>/logs/entered.log",
    message:
        "gather entered.csv"
    script:
        "../scripts/concealed_entered.py"


rule score:
    input:
        recordings="<concealed>/recordings/{scatteritem}",
        sealed="<concealed>/sealed/{scatteritem}",
        conceal="<concealed>/made/{scatteritem}.jsonl",
        diagnosis="<concealed>/diagnoses/{scatteritem}.jsonl",
        resolved="<concealed>/resolved/{scatteritem}.jsonl",
        peers="<concealed>/peers/{scatteritem}.jsonl",
        code=code("score"),
    output:
        "<concealed>/scores/{scatteritem}.jsonl",
    log:
        "<concealed>/logs/score/{scatteritem}.log",
    priority: 5
    threads: 1
    params:
        entered=entered_cases(),
    message:
        "open the seals of part {wildcards.scatteritem} and score"
    script:
        "../scripts/score.py"


rule concealed_cases:
    input:
        parts=parts_of_cases("scores"),
        code=code("score"),
    output:
        "<concealed>/cases.csv",
    log:
        "<concealed>/logs/cases.log",
    message:
        "gather cases.csv"
    script:
        "../scripts/concealed_cases.py"


rule concealed_summary:
    input:
        cases="<concealed_tables>/cases.csv",
        code=code("measures"),
    output:
        table=report("<concealed>/measures.csv", caption="../report/measures.rst", category="Blind benchmark"),
        text="<concealed>/measures.md",
        strata="<concealed>/strata.csv",
        record="<concealed>/track_record.csv",
    log:
        "<concealed>/logs/summary.log",
    message:
        "summarise the blind benchmark"
    script:
        "../scripts/concealed_summary.py"


rule concealed_figure:
    input:
        cases="<concealed_tables>/cases.csv",
        code=code("pictures"),
    output:
        svg=report("<concealed>/{figure}.svg", caption="../report/{figure}.rst", category="Blind benchmark"),
        png="<concealed>/{figure}.png",
    log:
        "<concealed>/logs/{figure}.log",
    wildcard_constraints:
        figure="|".join(PICTURES),
    message:
        "draw {wildcards.figure} of the blind benchmark"
    script:
        "../scripts/concealed_figure.py"


rule concealed_reference:
    input:
        "<concealed>/cases.csv",
        "<concealed>/measures.csv",
        "<concealed>/strata.csv",
        "<concealed>/track_record.csv",
        "<concealed>/entered.csv",
        expand("<concealed>/{figure}.png", figure=PICTURES),
    log:
        "<concealed>/logs/reference.log",
    params:
        folder=f"results/reference/{Path(BENCHMARK['results']).name}",
    message:
        "copy the benchmark's table to {params.folder}"
    shell:
        "mkdir -p {params.folder} && cp -v {input} {params.folder} > {log} 2>&1"
