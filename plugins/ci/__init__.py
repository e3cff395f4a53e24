"""What CI systems show: GitHub's annotations and job summary, SARIF, GitLab's code quality."""
