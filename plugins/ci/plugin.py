"""What the plugin ci adds."""

from wil_campaign.hooks import Announcer, ProblemFormat, implements


@implements
def announcers() -> tuple[Announcer, ...]:
    """Return what tells GitHub how a command ended."""
    module = "wil_campaign.plugins.ci.github_job"
    return (Announcer("ci", f"{module}:tell_problems", f"{module}:tell_verdicts"),)


@implements
def problem_formats() -> tuple[ProblemFormat, ...]:
    """Return SARIF, and the code quality of GitLab."""
    module = "wil_campaign.plugins.ci.problem_files"
    return (
        ProblemFormat(
            "sarif",
            f"{module}:sarif_text",
            "Write the faults as SARIF 2.1.0 to this FILE, as GitHub's code scanning reads it.",
            r'\{\s*"version": "2.1.0"',
        ),
        ProblemFormat(
            "codequality",
            f"{module}:code_quality_text",
            "Write the faults to this FILE as a code quality report of GitLab.",
            r"\[",
        ),
    )
