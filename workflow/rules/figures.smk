# From tables to what is read: nothing here simulates, except `example`, which replays two designs.


rule panels:
    input:
        trials="<tables>/trials.csv",
        code=code("figures"),
    output:
        svg=report("<results>/panels.svg", caption="../report/panels.rst", category="Figures"),
        png="<results>/panels.png",
    log:
        "<results>/logs/panels.log",
    message:
        "draw the paper's panels"
    script:
        "../scripts/panels.py"


rule ablation:
    input:
        trials="<tables>/trials.csv",
        code=code("figures"),
    output:
        svg=report("<results>/ablation.svg", caption="../report/ablation.rst", category="Figures"),
        png="<results>/ablation.png",
    log:
        "<results>/logs/ablation.log",
    message:
        "draw the ablation"
    script:
        "../scripts/ablation.py"


rule curve:
    input:
        sweep="<tables>/sweep.csv",
        trials="<tables>/trials.csv",
        code=code("figures"),
    output:
        svg=report("<results>/curve.svg", caption="../report/curve.rst", category="Figures"),
        png="<results>/curve.png",
        table=report("<results>/curve.csv", caption="../report/curve.rst", category="Summary"),
    log:
        "<results>/logs/curve.log",
    message:
        "draw the reduction against the share of random experiments that touch"
    script:
        "../scripts/curve.py"


rule forces:
    input:
        plans=expand("<results>/plans/{system}.csv", system=PLANNED),
        forces=expand("<results>/plans/{system}-forces.csv", system=PLANNED),
        code=code("forces"),
    output:
        plans="<results>/plans.csv",
        svg=report("<results>/forces.svg", caption="../report/forces.rst", category="Figures"),
        png="<results>/forces.png",
    log:
        "<results>/logs/forces.log",
    message:
        "draw planned contact forces beside MuJoCo's"
    script:
        "../scripts/forces.py"


rule example:
    input:
        fisher=lambda wildcards: first_designs(wildcards.system, "fisher"),
        uniform=lambda wildcards: first_designs(wildcards.system, "uniform"),
        code=simulation("examples"),
    output:
        svg=report(
            "<results>/example-{system}.svg",
            caption="../report/example.rst",
            category="Examples",
            labels={"system": "{system}", "kind": "picture"},
        ),
        png="<results>/example-{system}.png",
        gif=report(
            "<results>/example-{system}.gif",
            caption="../report/example.rst",
            category="Examples",
            labels={"system": "{system}", "kind": "film"},
        ),
    log:
        "<results>/logs/example-{system}.log",
    params:
        config=settings(select={"seeds": config["select"]["seeds"][:1]}),
    message:
        "draw a designed experiment of {wildcards.system} beside a random one"
    script:
        "../scripts/example.py"


rule summary:
    input:
        trials="<tables>/trials.csv",
        diagnostics="<tables>/diagnostics.csv",
        reach="<tables>/reach.csv",
        code=code("summary"),
    output:
        summary=report("<results>/summary.csv", caption="../report/summary.rst", category="Summary"),
        coverage=report("<results>/coverage.csv", caption="../report/coverage.rst", category="Summary"),
        text="<results>/summary.md",
    log:
        "<results>/logs/summary.log",
    message:
        "summarise the trials"
    script:
        "../scripts/summary.py"
