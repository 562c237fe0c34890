"""Schedules: the learning rate and ε as training goes on."""

from __future__ import annotations

from trainers.settings.learning import DQNSettings, LearningSettings


def epsilon_at(settings: DQNSettings, epoch: int, progress: float) -> float:
    """ε in an epoch (from 0); `progress` is the part of all epochs that is over."""
    if settings.epsilon_schedule == "exponential":
        return max(settings.epsilon_end, settings.epsilon_start * settings.epsilon_decay**epoch)
    fallen = min(1.0, progress / settings.epsilon_fraction)
    return settings.epsilon_start + (settings.epsilon_end - settings.epsilon_start) * fallen


def learning_rate_at(settings: LearningSettings, updates: int, progress: float) -> float:
    """Learning rate after `updates` updates."""
    if settings.learning_rate_schedule == "inverse_time":
        return settings.learning_rate / (1 + settings.learning_rate_decay * updates)
    return settings.learning_rate * (1 + (settings.learning_rate_end - 1) * progress)
