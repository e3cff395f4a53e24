import unittest

import launch
import launch_testing
import launch_testing.actions
import launch_testing.util
import pytest


@pytest.mark.launch_test
def generate_test_description():
    run = launch.actions.ExecuteProcess(cmd=["wil-campaign", "run", "test/campaign.yaml"])
    awake = launch_testing.util.KeepAliveProc()  # else the launch may end before its tests
    ready = launch_testing.actions.ReadyToTest()
    return launch.LaunchDescription([run, awake, ready]), {"run": run}


class Flight(unittest.TestCase):
    def test_it_ends(self, proc_info, run):
        proc_info.assertWaitForShutdown(process=run, timeout=1800)


@launch_testing.post_shutdown_test()
class Verdict(unittest.TestCase):
    def test_it_is_accepted(self, proc_info, run):
        launch_testing.asserts.assertExitCodes(proc_info, process=run)
