"""The course of docs/course: the tasks of each lesson, the check of an answer, and projects with data."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcpimpact.registry import Registry

if TYPE_CHECKING:
    from lcpimpact.course.lesson import Lesson
    from lcpimpact.course.projects import Project

LESSONS: Registry[Lesson] = Registry(
    "lesson",
    {
        "lesson-1": "lcpimpact.course.ball_on_a_floor:LESSON",
        "lesson-2": "lcpimpact.course.step_as_lcp:LESSON",
        "lesson-3": "lcpimpact.course.buffer:LESSON",
        "lesson-4": "lcpimpact.course.three_views:LESSON",
        "lesson-5": "lcpimpact.course.energy:LESSON",
        "lesson-6": "lcpimpact.course.zeno:LESSON",
        "lesson-7": "lcpimpact.course.friction:LESSON",
        "lesson-8": "lcpimpact.course.convergence:LESSON",
        "lesson-9": "lcpimpact.course.grazing:LESSON",
        "lesson-10": "lcpimpact.course.own_integrator:LESSON",
        "lesson-11": "lcpimpact.course.derivative:LESSON",
        "lesson-12": "lcpimpact.course.pendulum:LESSON",
    },
)
PROJECTS: Registry[Project] = Registry(
    "project",
    {
        "bounces": "lcpimpact.course.projects:BOUNCES",
        "buffer": "lcpimpact.course.projects:BUFFER",
        "belt": "lcpimpact.course.projects:BELT",
        "slope": "lcpimpact.course.projects:SLOPE",
        "stop": "lcpimpact.course.projects:STOP",
    },
)
