def compare_hosts(folder):
    return 1
