"""The ground floor: what every package stands on, and what knows nothing of vehicles or campaigns.

files: documents of users, their faults and limits. clocks: event loops in virtual and scaled time.
processes: children, their descendants, their messages. tasks: no exception is lost.
"""
