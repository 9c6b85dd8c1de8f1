"""fimpact: plan the experiment that tells a robot model most."""

from fimpact.runtime import configure

configure()
