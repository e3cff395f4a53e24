"""What a machine has and lacks for flying campaigns, with the remedy for each lack."""
