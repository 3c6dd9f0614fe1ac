"""Learners of object classes, all with one interface: a two-layer network, a convolutional network, and gradient-boosted trees."""

from __future__ import annotations

from radartwin.recognize.learners.convolution import Convolution
from radartwin.recognize.learners.interface import Fitted, Learner
from radartwin.recognize.learners.network import Network
from radartwin.recognize.learners.trees import Trees

LEARNERS: dict[str, Learner] = {"network": Network(), "convolution": Convolution(), "trees": Trees()}

__all__ = ["LEARNERS", "Convolution", "Fitted", "Learner", "Network", "Trees"]
