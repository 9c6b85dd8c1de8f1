# From the configuration to tables: everything that simulates.


# Cold, this takes minutes; without it, jobs that start together would each compile the same programs.
rule compile:
    input:
        code=lambda wildcards: code("compile", wildcards.system),
    output:
        "<results>/compiled/{system}.txt",
    log:
        "<results>/logs/compile-{system}.log",
    threads: 1
    params:
        config=settings(),
    message:
        "compile the programs of {wildcards.system}"
    script:
        "../scripts/compile.py"


rule trials:
    input:
        compiled="<results>/compiled/{system}.txt",
        code=simulation("trial"),
    output:
        trials="<results>/trials/{system}-{method}-{scatteritem}.csv",
        diagnostics="<results>/trials/{system}-{method}-{scatteritem}-diagnostics.csv",
        designs="<results>/trials/{system}-{method}-{scatteritem}-designs.npz",
    log:
        "<results>/logs/trials/{system}-{method}-{scatteritem}.log",
    threads: 1
    params:
        config=trial_settings,
        seeds=lambda wildcards: share(seeds_of(wildcards.method), wildcards),
    message:
        "trials of {wildcards.system}, {wildcards.method}, seeds {params.seeds}"
    script:
        "../scripts/trials.py"


rule sweep:
    input:
        compiled="<results>/compiled/{system}.txt",
        code=simulation("trial"),
    output:
        "<results>/sweep/{system}-{method}-{scatteritem}.csv",
    log:
        "<results>/logs/sweep/{system}-{method}-{scatteritem}.log",
    threads: 1
    params:
        config=sweep_settings,
        surfaces=lambda wildcards: share(config["sweep"]["surfaces"][wildcards.system], wildcards),
    message:
        "sweep of {wildcards.system}, {wildcards.method}, surface at {params.surfaces} m"
    script:
        "../scripts/sweep.py"


rule reach:
    input:
        compiled="<results>/compiled/{system}.txt",
        code=simulation("reach"),
    output:
        "<results>/reach/{system}.csv",
    log:
        "<results>/logs/reach/{system}.log",
    threads: 1
    params:
        config=settings(design=designing("fisher"), reach={"seeds": config["reach"]["seeds"]}),
    message:
        "reach of {wildcards.system}: designs from starts without contact"
    script:
        "../scripts/reach.py"


rule plans:
    input:
        compiled="<results>/compiled/{system}.txt",
        code=simulation("plans"),
    output:
        plans="<results>/plans/{system}.csv",
        forces="<results>/plans/{system}-forces.csv",
    log:
        "<results>/logs/plans/{system}.log",
    threads: 1
    params:
        config=settings(design=designing("contact_implicit"), reach={"planned": config["reach"]["planned"]}),
    message:
        "plans of {wildcards.system}: contact-implicit, from starts without contact"
    script:
        "../scripts/plans.py"


rule identifiability:
    input:
        compiled="<results>/compiled/{system}.txt",
        code=simulation("reach"),
    output:
        report(
            "<results>/identifiability-{system}.md",
            caption="../report/identifiability.rst",
            category="Identifiability",
            labels={"system": "{system}"},
        ),
    log:
        "<results>/logs/identifiability-{system}.log",
    threads: 1
    params:
        config=settings(design=designing("fisher")),
    message:
        "identifiability of {wildcards.system}"
    script:
        "../scripts/identifiability.py"


rule gather:
    input:
        parts=lambda wildcards: pieces(wildcards.table),
        code=code("tables"),
    output:
        "<results>/{table}.csv",
    log:
        "<results>/logs/gather-{table}.log",
    wildcard_constraints:
        table="trials|diagnostics|sweep|reach",
    params:
        systems=SYSTEMS,
        methods=METHODS + [m for m in config["sweep"]["methods"] if m not in METHODS],
    message:
        "gather {wildcards.table}.csv"
    script:
        "../scripts/gather.py"


rule reference:
    input:
        expand("<results>/{name}", name=REFERENCE),
    log:
        "<results>/logs/reference.log",
    params:
        folder=f"results/reference/{Path(config['results']).name}",
    message:
        "copy tables to {params.folder}"
    shell:
        "mkdir -p {params.folder} && cp -v {input} {params.folder} > {log} 2>&1"
