"""Tables whose numbers are known by hand."""

import numpy as np
import pandas as pd
import pytest
import synthetic

from fimpact.paper import estimate
from fimpact.paper.measures import errors, final, information_ratio, reduction, touched
from fimpact.paper.summary import (
    FAR,
    coverage,
    coverage_to_markdown,
    percent,
    reduction_curve,
    summarise,
    times,
    to_markdown,
)

FISHER, UNIFORM = [0.01, 0.02, 0.03, 0.04], [0.1, 0.2, 0.3, 0.4]


@pytest.fixture
def known():
    """The arm, four seeds, one experiment; every error of `fisher` is a tenth of `uniform`'s."""
    return synthetic.trials({"fisher": FISHER, "uniform": UNIFORM}, contact={"uniform": False})


def row(table, method, system="arm"):
    return table[(table.method == method) & (table.system == system)].iloc[0]


def fail(trials, method, seed, number):
    """Mark one experiment as failed."""
    failed = (trials.method == method) & (trials.seed == seed) & (trials["round"] == number)
    trials.loc[failed, ["estimate", "relative_error"]] = np.nan
    trials.loc[failed, "status"] = "failed: no finite start"
    return trials


def summarised(trials):
    return summarise(trials, synthetic.diagnose(trials), synthetic.reach())


def test_error_is_the_root_mean_square_over_parameters_whatever_their_sign():
    rows = synthetic.experiment("arm", "fisher", 0, 0, 0.3, 0.0, 0)
    rows[0]["relative_error"], rows[1]["relative_error"] = 0.03, -0.04
    assert errors(pd.DataFrame(rows)).iloc[0, 0] == pytest.approx(np.sqrt((9 + 16) / 2) / 100)


def test_known_reduction(known):
    fisher = row(summarised(known), "fisher")
    assert fisher.final_error == pytest.approx(0.025)
    assert (fisher.error_q25, fisher.error_q75) == pytest.approx((0.0175, 0.0325))
    assert fisher.reduction == pytest.approx(0.9)


def test_interval_is_paired_by_seed(known):
    # With a constant ratio every paired resample gives the same reduction; an unpaired one would not.
    fisher = row(summarised(known), "fisher")
    assert (fisher.reduction_low, fisher.reduction_high) == pytest.approx((0.9, 0.9))


def test_interval_holds_the_estimate_and_repeats_exactly():
    rng = np.random.default_rng(1)
    error, baseline = rng.lognormal(-4, 0.5, 20), rng.lognormal(-1.5, 0.3, 20)
    middle, low, high = reduction(error, baseline)
    assert low < middle < high < 1
    assert (middle, low, high) == reduction(error, baseline)


def test_one_seed_has_no_interval():
    middle, low, high = reduction([0.1], [0.4])
    assert middle == pytest.approx(0.75) and np.isnan(low) and np.isnan(high)


def test_reduction_of_fisher_against_a_better_method_is_negative():
    trials = synthetic.trials({"fisher": [0.2] * 3, "uniform": [0.25] * 3, "best_of_n": [0.1] * 3})
    assert row(summarised(trials), "best_of_n").fisher_reduction == pytest.approx(-1.0)


def test_failed_seed_keeps_its_last_valid_error_and_is_counted():
    trials = synthetic.trials({"fisher": [0.003] * 3, "uniform": [0.3] * 3}, rounds=2)
    fisher = final(errors(fail(trials, "fisher", 1, 2)))["fisher"]
    assert fisher.tolist() == pytest.approx([0.003, 0.03, 0.003])
    table = summarised(trials)
    assert (row(table, "fisher").failed, row(table, "uniform").failed) == (1, 0)
    assert row(table, "fisher").agreement == pytest.approx(2 / 3)


def test_one_parameter_without_a_value_fails_the_round(known):
    known.loc[(known["round"] == 1) & (known.parameter == "length_1"), "relative_error"] = np.nan
    assert final(errors(known)).to_numpy() == pytest.approx(0.3)


def test_seed_that_fails_at_once_and_stops_counts_as_its_initial_guess(known):
    trials = fail(synthetic.trials({"fisher": FISHER, "uniform": UNIFORM}, rounds=2), "fisher", 0, 1)
    trials = trials[~((trials.method == "fisher") & (trials.seed == 0) & (trials["round"] == 2))]
    assert final(errors(trials))["fisher"][0] == pytest.approx(0.3)


def test_missing_seed_is_an_error_not_a_smaller_table(known):
    with pytest.raises(ValueError, match=r"'fisher' has no rows for seeds \[2\]"):
        summarised(known[~((known.method == "fisher") & (known.seed == 2))])


def test_a_method_of_fewer_seeds_is_compared_on_those():
    trials = synthetic.trials({"fisher": [0.1] * 4, "uniform": [0.4, 0.4, 0.2, 0.2], "contact_implicit": [0.1] * 4})
    trials = trials[~((trials.method == "contact_implicit") & (trials.seed < 2))]
    found = row(summarised(trials), "contact_implicit")
    assert found.seeds == 2 and found.reduction == pytest.approx(0.5) and found.fisher_reduction == pytest.approx(0)
    assert row(summarised(trials), "fisher").seeds == 4 and found.information_ratio_min == 1


def test_information_ratio_knows_experiments_that_tell_nothing(known):
    at = (known["round"] == 1) & (known.method == "uniform")
    known.loc[at & (known.seed == 0), "information_trace"] = 4e-27  # rounding of a sensor that never fired
    known.loc[at & (known.seed == 1), "information_trace"] = 25.0
    ratio = information_ratio(known)
    assert ratio["fisher"].tolist() == [np.inf, 4, 1, 1]
    assert ratio["uniform"].tolist() == [1, 1, 1, 1]
    assert row(summarised(known), "fisher").information_ratio_min == 1


def test_time_and_contact_belong_to_the_experiment_not_to_the_parameter(known):
    table = summarised(known)
    assert row(table, "fisher").seconds == 4 * 2.0
    assert (row(table, "fisher").touched, row(table, "uniform").touched) == (1.0, 0.0)
    assert touched(known) == 0.5


def test_reached_counts_only_starts_without_contact():
    trials = synthetic.campaign(4, 1)
    reach = synthetic.reach()
    reach.loc[(reach.system == "arm") & (reach.seed == 1), "start_contact_steps"] = 5
    table = summarise(trials, synthetic.diagnose(trials), reach)
    assert row(table, "fisher").reached == pytest.approx(2 / 3)
    assert row(table, "fisher", "block").reached == 1.0
    assert row(table, "fisher", "block").reached_at_guess == 0.5
    assert np.isnan(row(table, "uniform").reached)


def test_coverage_per_parameter_is_of_the_last_round():
    trials = synthetic.campaign(4, 2)
    diagnostics = synthetic.diagnose(trials)
    diagnostics.loc[diagnostics["round"] == 1, "covered"] = 0
    table = coverage(diagnostics, trials)
    assert len(table) == 2 * 6 * 2
    assert (table.covered == 0.75).all() and (table.seeds == 4).all()
    assert "| arm | inertia_1 | 75 % | 2.0 % | 4 | 0 |" in coverage_to_markdown(table)


def test_a_fit_far_above_the_noise_claims_no_interval():
    trials = synthetic.campaign(4, 2)
    wrong = (trials.method == "fisher") & (trials.seed == 0) & (trials["round"] == 2)
    trials.loc[wrong, "status"] = FAR
    table = coverage(synthetic.diagnose(trials), trials)
    fisher = table[table.method == "fisher"]
    assert (fisher.covered == 1.0).all() and (fisher.seeds == 3).all() and (fisher.withheld == 1).all()
    assert (table[table.method != "fisher"].covered == 0.75).all()
    summary = summarised(trials)
    assert (row(summary, "fisher").coverage, row(summary, "fisher").withheld) == (1.0, 1)
    assert row(summary, "fisher").agreement == 0.75


def test_summary_and_estimator_call_a_wrong_fit_by_the_same_name():
    assert FAR == estimate.FAR


def test_curve_has_a_row_per_surface_and_its_own_share_of_touches():
    sweep = synthetic.sweep((0.6, 0.8), 4)
    table = reduction_curve(sweep)
    assert table[["system", "surface"]].to_numpy().tolist() == [
        ["arm", 0.6],
        ["arm", 0.8],
        ["block", 0.6],
        ["block", 0.8],
    ]
    assert (table.seeds == 4).all() and (table.reduction_low <= table.reduction_high).all()
    trials = sweep[(sweep.system == "arm") & (sweep.surface == 0.6) & (sweep.method == "uniform")]
    assert table.touched[0] == touched(trials) > table.touched[1]


def test_markdown_has_a_line_per_method_with_intervals(known):
    lines = to_markdown(summarised(known)).splitlines()
    assert len({line.count("|") for line in lines[:4]}) == 1
    assert "| arm | fisher | 2.5 % (1.8 to 3.2 %) | 90.0 % (90.0 to 90.0 %) | – |" in lines[2]
    assert "75 %" in lines[-1]


def test_numbers_read_well():
    assert (percent(0.1234), percent(0.0042), percent(-0.5, 0), percent(np.nan)) == ("12.3 %", "0.42 %", "−50 %", "–")
    assert (times(np.inf), times(12345.6), times(3.14)) == ("∞", "12,346 ×", "3.1 ×")
