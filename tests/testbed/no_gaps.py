"""The strengths of a testbed without any gap."""

from dataclasses import fields

from radartwin.testbed.testbed import Gaps

OFF = Gaps(**{one.name: 0.0 for one in fields(Gaps)})
