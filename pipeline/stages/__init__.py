"""One function a DVC stage; its signature is its contract with dvc.yaml."""
